#pragma once

#include "identification/problem/identification_options.hpp"
#include "identification/problem/identification_problem.hpp"
#include "identification/problem/identification_result.hpp"
#include "identification/problem/observer.hpp"

#pragma GCC visibility push(default)

namespace orbid::identification {

/// Estimates the parameters of a model from records of its chaotic motion, by a strategy that needs no good start:
/// stages run one after the other, each from the best before it. Then nodes are judged and other models compared.
///
/// The same problem and options give the same result to the bit, with any number of threads.
///
/// @return status `interrupted` when the observer stops it; the estimate of the last stage that succeeded otherwise.
/// @throws std::invalid_argument for a problem or options that contradict themselves; orbits::DataError when the data
///         do not suffice; WrongModel (starts/derivative_self_check.hpp) when the model's derivatives are not those of
///         its equations.
[[nodiscard]] IdentificationResult identify(const IdentificationProblem& problem, const Options& options,
                                            Observer& observer);

/// The same without an observer.
[[nodiscard]] IdentificationResult identify(const IdentificationProblem& problem, const Options& options = {});

}  // namespace orbid::identification

#pragma GCC visibility pop
