#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "apps/job/data_job.hpp"
#include "orbits/records/series.hpp"

namespace orbid::apps {

/// Indices of the segments with these labels, in the order of the labels.
/// @throws orbits::DataError naming experiment and label of a missing segment.
[[nodiscard]] std::vector<std::size_t> segments_with(const orbits::Series& series, const DataJob& data,
                                                     const std::vector<std::string>& labels);

/// Indices of the segments an experiment is fitted to: the named ones, or all that are not predicted.
/// @throws orbits::DataError as segments_with.
[[nodiscard]] std::vector<std::size_t> fitted_segments(const orbits::Series& series, const DataJob& data);

}  // namespace orbid::apps
