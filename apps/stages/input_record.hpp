#pragma once

#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "apps/job/job.hpp"
#include "models/definition/input_signal.hpp"
#include "models/system/system.hpp"
#include "orbits/records/series.hpp"

namespace orbid::apps {

using Inputs = std::vector<std::shared_ptr<const models::InputSignal>>;
/// Each with the label of its segment.
using LabelledInputs = std::vector<std::pair<std::string, std::shared_ptr<const models::InputSignal>>>;

/// Measured inputs of an experiment: one signal per segment if they are in the data's table, else one. Empty when the
/// model has none. They are read whole, whatever part of the record is read.
/// @param delay  [s] in place of that of the job, which is 0 where a parameter says it.
/// @throws orbits::DataError naming file and line: a missing value, times that do not ascend, as the reader of tables;
///         a segment of one row.
[[nodiscard]] LabelledInputs load_inputs(const Job& job, const DataJob& data,
                                         std::optional<double> delay = std::nullopt);

/// The model of the job with the only signal of a simulated experiment.
[[nodiscard]] std::shared_ptr<const models::System> system_with(const Job& job, const LabelledInputs& inputs);

/// One signal per segment.
[[nodiscard]] Inputs by_segment(const LabelledInputs& inputs, const std::vector<orbits::Segment>& segments);

}  // namespace orbid::apps
