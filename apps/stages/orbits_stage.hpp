#pragma once

#include <optional>

#include "apps/results/cycle_file.hpp"
#include "apps/stages/searched_section.hpp"
#include "apps/stages/workspace.hpp"
#include "orbits/invariants/invariants.hpp"

namespace orbid::apps {

/// Whether an estimate uses the job's cycles in none but stages that are run if needed.
[[nodiscard]] bool are_cycles_optional(const Job& job);

/// The heading of every list of cycles or orbits of this job.
[[nodiscard]] CycleFileHead cycle_file_head(const Job& job, Fingerprint fingerprint);
/// Of cycles that were searched for in this section.
[[nodiscard]] CycleFileHead cycle_file_head(const Job& job, const SearchedSection& section, Fingerprint fingerprint);

/// The list of cycles that the job names.
/// @throws orbits::DataError as read_cycles(), and when its cycles are points of another plane than the job's section.
[[nodiscard]] CycleFile named_cycles(const Job& job);

/// The cycles of the job: read from its file, or searched in the series and stored as cycles.json, which is reused
/// while its fingerprint fits. Requested periods that were not found are reported.
///
/// @param section  to search; not needed for a list from a file.
/// @throws orbits::DataError when the list cannot be read or the series is too short, StaleFile as reusable() does.
[[nodiscard]] orbits::CycleSearch load_cycles(const Workspace& work, const std::optional<SearchedSection>& section);

/// Exponents, dimensions and entropies of the searched series and its cycles, stored as invariants.json.
/// @throws orbits::DataError when the series is too short.
[[nodiscard]] orbits::Invariants compute_invariants(const Workspace& work, const SearchedSection& section,
                                                    const orbits::CycleSearch& search);

}  // namespace orbid::apps
