#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "apps/job/job.hpp"
#include "apps/results/cycle_file.hpp"
#include "orbits/cycles/cycle_search.hpp"
#include "orbits/records/series.hpp"

namespace orbid::apps {

/// The section of a job's record, with the search's options in its coordinates.
struct SearchedSection {
    const orbits::Series* record = nullptr;
    std::optional<orbits::Series> cut;  ///< made from the record if that is not yet a section
    orbits::CycleSearchOptions options;
    std::string remark;  ///< how the section was made from the record; empty: it was one

    [[nodiscard]] const orbits::Series& series() const { return cut ? *cut : *record; }
};

/// Crossings of a plane lose the coordinate that is constant there. Samples are cut by the job's plane or at its phase
/// of the forcing. Keeps a reference to the record.
/// @param interrupted  asked all along.
/// @throws orbits::DataError when the samples cannot be cut; models::Stopped.
[[nodiscard]] SearchedSection searched_section(const Job& job, const orbits::Series& record,
                                               const std::function<bool()>& interrupted);

/// The coordinates of the points of the job's cycles: the model's, without the plane's.
[[nodiscard]] std::vector<orbits::SeriesCoordinate> section_coordinates(const Job& job);

/// The job's section, as lists of cycles name it.
[[nodiscard]] std::optional<SectionPlane> section_plane(const Job& job);

}  // namespace orbid::apps
