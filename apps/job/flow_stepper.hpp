#pragma once

#include <memory>
#include <string>

#include "apps/job/job.hpp"

namespace orbid::apps {

/// The system with its flows computed by a stepper.
/// @throws std::invalid_argument where odeint_refusal() says why it cannot be.
[[nodiscard]] std::shared_ptr<const models::System> with_stepper(std::shared_ptr<const models::System> system,
                                                                 FlowStepper stepper);

/// Why the flows of a job cannot be left to Boost.Odeint, and what could be done about it: a model that it cannot
/// integrate, or equations that jump at the job's parameters, those of an experiment, or when a parameter that is
/// estimated or followed leaves its start. Empty: they can.
[[nodiscard]] std::string odeint_refusal(const Job& job);

/// All parameters, the estimated ones at their starts. Shape (q).
[[nodiscard]] Eigen::VectorXd starting_parameters(const Job& job);

/// Parameters for which the equations of a job jump, at the job's values or when an estimated one leaves 0, "k1, k2";
/// "the equations" where they always do. Empty: they are smooth.
[[nodiscard]] std::string causes_of_jumps(const Job& job);

}  // namespace orbid::apps
