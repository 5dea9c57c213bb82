#pragma once

#include <array>
#include <optional>
#include <vector>

#include "apps/stored_run/stored_run.hpp"
#include "orbits/records/series.hpp"

namespace orbid::apps {

/// Points of a section, for a plot of two of their coordinates.
struct SectionPoints {
    std::array<orbits::SeriesCoordinate, 2> coordinates;
    std::vector<double> x;
    std::vector<double> y;
};

/// The points of a stored run's section, its first two coordinates: the record that is searched for cycles, or the
/// first one; samples are cut as the job says. Points with a missing coordinate are left out.
/// @return nothing when the record is not stored, or shows no section of two coordinates.
/// @throws orbits::DataError when the record cannot be read.
[[nodiscard]] std::optional<SectionPoints> section_points(const StoredRun& run);

}  // namespace orbid::apps
