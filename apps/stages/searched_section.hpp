#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "apps/job/job.hpp"
#include "apps/results/cycle_file.hpp"
#include "orbits/cycles/cycle_search.hpp"
#include "orbits/records/series.hpp"
#include "orbits/records/series_stream.hpp"

namespace orbid::apps {

/// The section of a job's record, with the search's options in its coordinates.
struct SearchedSection {
    const orbits::Series* record = nullptr;
    std::optional<orbits::Series> cut;  ///< made from the record if that is not yet a section
    orbits::CycleSearchOptions options;
    std::string remark;                     ///< how the section was made from the record; empty: it was one
    std::vector<std::string> choices = {};  ///< what was chosen by the data, in sentences
    std::optional<SectionPlane> plane = {};
    std::vector<orbits::SeriesCoordinate> coordinates = {};  ///< of its points
    /// Read piece by piece, with so many bytes of memory; null: all points are in the series.
    std::shared_ptr<const orbits::SeriesStream> stream = {};
    std::size_t memory = 0;

    [[nodiscard]] const orbits::Series& series() const { return cut ? *cut : *record; }
};

/// Crossings of a plane lose the coordinate that is constant there. Samples are cut by the job's plane, by one that is
/// chosen by the data, or at the job's phase of the forcing. Where one coordinate of an autonomous flow is read, its
/// vectors of delays take the place of the states; its rise over one delay stands beside it, 0 where it has an
/// extremum. Keeps a reference to the record.
/// @param interrupted  asked all along.
/// @throws orbits::DataError when the samples cannot be cut; models::Stopped.
[[nodiscard]] SearchedSection searched_section(const Job& job, const orbits::Series& record,
                                               const std::function<bool()>& interrupted);

/// The coordinates of the points of the job's cycles: the model's, without the plane's.
[[nodiscard]] std::vector<orbits::SeriesCoordinate> section_coordinates(const Job& job);

/// The job's section, as lists of cycles name it.
[[nodiscard]] std::optional<SectionPlane> section_plane(const Job& job);

}  // namespace orbid::apps
