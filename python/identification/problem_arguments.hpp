#pragma once

#include <memory>

#include <pybind11/pybind11.h>

#include "identification/problem/identification_options.hpp"
#include "identification/problem/identification_problem.hpp"

namespace orbid::python {

class NamedArguments;

/// One record and its conditions from a dict: record (a Series), and as in a job name, sensor, observe, parameters,
/// free, initial_state; fit and predict (labels of segments), simulated (True: by this very model).
/// @throws TypeError, ValueError, KeyError naming the experiment and the key.
[[nodiscard]] identification::Experiment experiment(pybind11::handle description, const models::System& system,
                                                    std::size_t number);

/// Parameters of the model: a mapping from names to start values, or to dicts as under "parameters" of a job. What is
/// not said follows from the model: start, scale, bounds, unit and typical size.
[[nodiscard]] std::vector<identification::FreeModelParameter> model_parameters(pybind11::handle parameters,
                                                                               const models::System& system);

/// Takes what a problem has besides experiments and parameters: values, derived, joint_priors, cycles, search,
/// residuals.
void read_problem(NamedArguments& given, identification::IdentificationProblem& problem);

/// Takes strategy, scan, seed, variance, step_tolerance, starts and start_seed.
[[nodiscard]] identification::Options identification_options(NamedArguments& given);

}  // namespace orbid::python
