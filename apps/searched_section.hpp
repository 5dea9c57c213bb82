#pragma once

#include <optional>
#include <vector>

#include "apps/cycle_file.hpp"
#include "apps/job.hpp"
#include "orbits/cycle_search.hpp"
#include "orbits/series.hpp"

namespace orbid::apps {

/// The section that a job's record shows, with the search's options in its coordinates.
struct SearchedSection {
    const orbits::Series* series = nullptr;  ///< the record itself, or `cut`
    std::optional<orbits::Series> cut;       ///< made of the record
    orbits::CycleSearchOptions options;
};

/// A record of an autonomous flow loses the coordinate that is the same at all crossings. Keeps a reference to
/// `record`.
[[nodiscard]] SearchedSection searched_section(const Job& job, const orbits::Series& record);

/// What the points of the job's cycles are made of: the model's coordinates, without the plane's.
[[nodiscard]] std::vector<orbits::SeriesCoordinate> section_coordinates(const Job& job);

/// The job's section, as lists of cycles name it.
[[nodiscard]] std::optional<SectionPlane> section_plane(const Job& job);

}  // namespace orbid::apps
