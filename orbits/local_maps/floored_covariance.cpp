#include "orbits/local_maps/floored_covariance.hpp"

#include <algorithm>

#include <Eigen/Eigenvalues>

#include "orbits/local_maps/fit_limits.hpp"

namespace orbid::orbits {

Eigen::MatrixXd floored_covariance(const Eigen::MatrixXd& covariance) {
    // Relative to the largest eigenvalue: bounds the condition number.
    constexpr double relative_floor = 1e-9;
    Eigen::MatrixXd result = 0.5 * (covariance + covariance.transpose());
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(result, Eigen::EigenvaluesOnly);
    const double largest = std::max(0.0, solver.eigenvalues().maxCoeff());
    result.diagonal().array() += relative_floor * largest + rounding_variance;
    return result;
}

}  // namespace orbid::orbits
