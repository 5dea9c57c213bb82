#pragma once

#include <optional>
#include <string>
#include <vector>

#include "apps/job/job.hpp"
#include "apps/results/cycle_file.hpp"
#include "orbits/cycles/cycle_search.hpp"
#include "orbits/records/series.hpp"

namespace orbid::apps {

/// The section that a job's record shows, with the search's options in its coordinates.
struct SearchedSection {
    const orbits::Series* record = nullptr;
    std::optional<orbits::Series> cut;  ///< made of the record, where that is no section yet
    orbits::CycleSearchOptions options;
    std::string remark;  ///< what was made of the record; empty: nothing

    [[nodiscard]] const orbits::Series& series() const { return cut ? *cut : *record; }
};

/// Crossings of a plane lose the coordinate that is the same at all of them; samples are cut by the job's plane or at
/// its phase of the forcing. Keeps a reference to the record.
/// @throws orbits::DataError when the samples cannot be cut.
[[nodiscard]] SearchedSection searched_section(const Job& job, const orbits::Series& record);

/// What the points of the job's cycles are made of: the model's coordinates, without the plane's.
[[nodiscard]] std::vector<orbits::SeriesCoordinate> section_coordinates(const Job& job);

/// The job's section, as lists of cycles name it.
[[nodiscard]] std::optional<SectionPlane> section_plane(const Job& job);

}  // namespace orbid::apps
