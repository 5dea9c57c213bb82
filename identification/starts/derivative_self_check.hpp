#pragma once

#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "identification/problem/estimate_setup.hpp"
#include "identification/problem/problem_residuals.hpp"
#include "models/system/system.hpp"
#include "orbits/cycles/cycle_search.hpp"

namespace orbid::identification {

/// The derivatives of a model are not those of its equations: no estimate from them can be right.
class WrongModel : public std::runtime_error {
    using std::runtime_error::runtime_error;
};

/// A flow whose derivatives are compared with differences.
struct FlowStart {
    std::shared_ptr<const models::System> system;
    Eigen::VectorXd state;  ///< shape (n)
    double phase = 0.0;
    std::vector<double> durations;
    models::Clock clock = models::Clock::time;
    Eigen::VectorXd theta;           ///< shape (q)
    std::vector<Eigen::Index> free;  ///< parameters that are estimated
};

/// The first flow of an estimate, at the start values: the first ten intervals of the first fitted segment, or from a
/// point of the first cycle to the next section. Empty when there is neither, or its state is not finite.
[[nodiscard]] std::optional<FlowStart> first_flow(const IdentificationProblem& problem, const EstimateSetup& setup,
                                                  const ProblemResiduals& residuals,
                                                  const models::ParameterBinding& cycle_binding, std::uint64_t seed);

/// Compares the derivatives of a flow with differences, and describes their agreement in one line. Models of more than
/// 100 directions are skipped, which the line says: the cost grows with the square of their number.
/// @throws WrongModel naming the entry that disagrees worst.
[[nodiscard]] std::string compare_derivatives(const FlowStart& start);

}  // namespace orbid::identification
