#pragma once

#include <cstddef>
#include <functional>
#include <memory>

#include "apps/job/job.hpp"
#include "orbits/records/series.hpp"
#include "orbits/records/series_stream.hpp"

namespace orbid::apps {

/// A coordinate as the sensor of an experiment reads it.
[[nodiscard]] orbits::SeriesCoordinate read_coordinate(const Job& job, const DataJob& data, std::size_t index);

/// The record of an experiment that the job reads from a file.
/// @param interrupted  asked while reading
/// @throws orbits::DataError when the file cannot be read or does not fit the job's kind and model; models::Stopped.
[[nodiscard]] orbits::Series recorded_series(const Job& job, std::size_t experiment,
                                             const std::function<bool()>& interrupted = {});

/// The same of an experiment that is read piece by piece. A table is read once, to check it.
[[nodiscard]] std::unique_ptr<orbits::SeriesStream> recorded_stream(const Job& job, std::size_t experiment,
                                                                    const std::function<bool()>& interrupted = {});

}  // namespace orbid::apps
