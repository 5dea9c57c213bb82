#pragma once

#include <span>

#include "apps/job/job.hpp"
#include "apps/stages/data_stage.hpp"

namespace orbid::apps {

/// The size of a model's states for System::with_state_size(): the largest value of a coordinate among initial states
/// and periodic points of the job and its records, as a power of two, so that a change of units by one changes nothing
/// but units. At most 1, which it is of models with angles, and where nothing tells: records of larger states need no
/// looser tolerance.
///
/// @param data  records; may be empty
[[nodiscard]] double state_size(const Job& job, std::span<const Experiment> data);

}  // namespace orbid::apps
