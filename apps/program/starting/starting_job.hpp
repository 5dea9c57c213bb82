#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace orbid::apps {

/// Purposes of a new job: "simulate" (sampled data; iterates of a map), "auto" (parameters by all stages that the data
/// allow), "cycles" (parameters from periodic orbits of a section series), "series" (parameters from sampled data);
/// "periodic", "search" and "continuation" (periodic orbits of the model, without data). Every model allows the first.
[[nodiscard]] std::vector<std::string> starting_tasks();

/// Models of a new job: the registered ones, and "equations", a small model written in the job.
[[nodiscard]] std::vector<std::string> starting_models();

/// A commented job that runs unchanged: it simulates its own data, to be replaced by a file.
/// @throws std::invalid_argument for an unknown model or task, for cycles of autonomous models, series of maps, and
///         periodic orbits of models that are driven by measured inputs.
[[nodiscard]] std::string starting_job(std::string_view model, std::string_view task);

}  // namespace orbid::apps
