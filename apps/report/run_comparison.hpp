#pragma once

#include <string>

#include "apps/stored_run/stored_run.hpp"

namespace orbid::apps {

/// Two stored runs beside each other, as tables: status, common parameters and derived quantities with their
/// difference in sds of it, error scales, evidence where the data agree, cycles found in both, and where the jobs
/// differ (JSON Pointers).
///
///     z = (a - b) / sqrt(sd_a^2 + sd_b^2)
///
/// holds for independent data. Of the same data the errors of both are correlated; then z is too small, and it is said.
/// @throws StoredRunRefused when there is nothing to compare: no parameter, derived quantity, cycle or computed orbit
///         that both have; the message says what each of them holds.
[[nodiscard]] std::string comparison_text(const StoredRun& first, const StoredRun& second);

}  // namespace orbid::apps
