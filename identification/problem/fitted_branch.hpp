#pragma once

#include <string>
#include <vector>

#include <Eigen/Core>

#include "identification/problem/estimate_setup.hpp"
#include "periodic/branches/branch.hpp"
#include "periodic/waveforms/branch_residual.hpp"

namespace orbid::identification {

/// A piece of the branch of an estimate.
struct FittedPiece {
    std::string from;         ///< where it was followed from: "the start", "U = 14.9"
    periodic::Branch branch;  ///< amplitudes: of the coordinates as the instrument reads them, then of the readings
};

/// The branch of the model at an estimate, as a branch residual compares motions with it. It is followed from the
/// problem's start both ways, and from the orbit of every motion that does not lie on it: where the branch is in
/// pieces, these are all that was compared.
/// @param active  the residual's at the estimate
/// @throws models::Stopped
[[nodiscard]] std::vector<FittedPiece> fitted_branch(const IdentificationProblem& problem, const EstimateSetup& setup,
                                                     const periodic::BranchResidual& residual,
                                                     const estimator::ActiveSet& active, const Eigen::VectorXd& theta);

/// The amplitude of an orbit at phase 0: of coordinates as the instrument reads them, then of the readings. Empty if it
/// cannot be simulated.
[[nodiscard]] periodic::OrbitAmplitude amplitude_by_readings(const models::System& system,
                                                             const Eigen::VectorXd& values,
                                                             const periodic::PeriodicOrbit& orbit,
                                                             const std::vector<periodic::OrbitReading>& readings);

/// Amplitudes of a branch's points, of coordinates as the instrument reads them and of the readings behind them.
/// @param values  of all parameters; that of the branch is the point's.
void add_amplitudes(const models::System& system, Eigen::VectorXd values,
                    const std::vector<periodic::OrbitReading>& readings, periodic::Branch& branch);

}  // namespace orbid::identification
