#pragma once

#include <optional>

#include "apps/drawing/section_plot.hpp"
#include "apps/stored_run/stored_run.hpp"

namespace orbid::apps {

/// The points of a stored run's section, first two coordinates. The record is the one searched for cycles, or the
/// first; samples are cut as the job says. Points with a missing coordinate are left out.
/// @return nothing when the record is not stored, or shows no section of two coordinates.
/// @throws orbits::DataError when the record cannot be read.
[[nodiscard]] std::optional<SectionPoints> section_points(const StoredRun& run);

}  // namespace orbid::apps
