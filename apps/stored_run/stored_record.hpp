#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "apps/stored_run/stored_run.hpp"

/// What plots need from the rows of residuals.csv.
namespace orbid::apps::catalog {

/// Whether a row is a point of a cycle, not a reading of a series.
[[nodiscard]] bool is_cycle(const ResidualRow& row);

/// The rows of a run that has some.
/// @throws orbits::DataError when there are none or they cannot be read.
[[nodiscard]] std::vector<ResidualRow> rows_of(const StoredRun& run);

/// Unit of the model's time as far as its parameters tell: "s", or nothing when none of them has seconds.
[[nodiscard]] std::string time_unit(const ModelJob& model);

/// A coordinate of the model as in a series, without a unit if that is 1; also for unknown names.
[[nodiscard]] orbits::SeriesCoordinate coordinate_of(const ModelJob& model, const std::string& name);

/// The stride in a list that shows at most `most` entries.
[[nodiscard]] std::size_t stride(std::size_t count, std::size_t most);

/// Whether the records of an experiment have times; sections of forced systems have phases.
[[nodiscard]] bool is_sampled(const StoredRun& run, const std::string& experiment);

}  // namespace orbid::apps::catalog
