#pragma once

#include <memory>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "identification/problem/estimate_setup.hpp"
#include "periodic/branches/continuation.hpp"
#include "periodic/waveforms/branch_residual.hpp"

namespace orbid::identification {

/// Makes the branch residual of a problem, with first solutions at `start`: the model's branch there, followed from the
/// problem's start over the measured values of the parameter, gives candidates for every motion.
/// @return one line per motion whose orbit was not found, when others have theirs
/// @throws orbits::DataError when no branch begins at the start, or no motion has an orbit on it; models::Stopped.
[[nodiscard]] std::vector<std::string> add_branch(const IdentificationProblem& problem, const EstimateSetup& setup,
                                                  const Eigen::VectorXd& start,
                                                  std::unique_ptr<periodic::BranchResidual>& residual);

/// The branch through `asked.start` at these values of all parameters, over the measured ones. Without those switched
/// to.
[[nodiscard]] periodic::BifurcationDiagram followed_branch(const models::System& system, const BranchChoice& asked,
                                                           const Eigen::VectorXd& values);

}  // namespace orbid::identification
