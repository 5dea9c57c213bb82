#pragma once

#include <memory>
#include <vector>

#include "apps/job/job.hpp"
#include "models/definition/input_signal.hpp"
#include "models/system/system.hpp"

namespace orbid::apps {

using Inputs = std::vector<std::shared_ptr<const models::InputSignal>>;

/// Measured inputs of an experiment: one signal per segment if they are in the data's table, else one. Empty when the
/// model has none.
/// @throws orbits::DataError naming file and line: a missing value, times that do not ascend, as the reader of tables;
///         a segment of one row.
[[nodiscard]] Inputs load_inputs(const Job& job, const DataJob& data);

/// The model of the job with the only signal of a simulated experiment.
[[nodiscard]] std::shared_ptr<const models::System> system_with(const Job& job, const Inputs& inputs);

/// One signal per segment.
[[nodiscard]] Inputs by_segment(const Inputs& inputs, std::size_t segments);

}  // namespace orbid::apps
