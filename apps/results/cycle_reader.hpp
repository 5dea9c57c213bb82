#pragma once

#include <filesystem>
#include <optional>
#include <string_view>
#include <vector>

#include "apps/documents/json_document.hpp"
#include "apps/results/cycle_file.hpp"

namespace orbid::apps {

/// What a text in the format orbid-cycles/1 holds; `file` is empty when anything is wrong, and `problems` says what,
/// all of it, with pointers and lines.
struct CycleReading {
    std::optional<CycleFile> file;
    std::vector<Problem> problems;
};

/// Reads cycles.json (or orbits.json: what is more there is skipped) of a model in the coordinates of its section. Only
/// `period` and `points` of each cycle are required. Left out or null: rotation, covariance, multipliers and
/// ln_multiplier are empty, recurrences 0, mirror none, times nan; head: the coordinates given, no phase and no plane.
/// A stored fingerprint that does not fit its keys is left out, so that the file counts as stale. Numbers that were
/// null inside a list become nan.
///
/// Refused: another format, another model, other coordinates or units (in their order), a period that is not the number
/// of points, wrong shapes, covariances that are not symmetric with a positive diagonal, unknown keys. Angles outside
/// (-pi, pi] are brought into it; all other numbers are kept to the bit.
[[nodiscard]] CycleReading parse_cycles(std::string_view text, std::string_view model,
                                        const std::vector<orbits::SeriesCoordinate>& coordinates);

/// The same from a file.
/// @throws orbits::DataError with one line per problem (file, line, pointer, rule), or naming path and reason when the
///         file cannot be read.
[[nodiscard]] CycleFile read_cycles(const std::filesystem::path& path, std::string_view model,
                                    const std::vector<orbits::SeriesCoordinate>& coordinates);

}  // namespace orbid::apps
