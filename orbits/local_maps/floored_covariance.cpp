#include "orbits/local_maps/floored_covariance.hpp"

#include <algorithm>

#include "models/arithmetic/eigenvalues.hpp"
#include "orbits/local_maps/fit_limits.hpp"

namespace orbid::orbits {

Eigen::MatrixXd floored_covariance(const Eigen::MatrixXd& covariance) {
    // Relative to the largest eigenvalue: bounds the condition number.
    constexpr double relative_floor = 1e-9;
    Eigen::MatrixXd result = 0.5 * (covariance + covariance.transpose());
    const double largest = std::max(0.0, models::symmetric_eigenvalues(result).maxCoeff());
    result.diagonal().array() += relative_floor * largest + rounding_variance;
    return result;
}

}  // namespace orbid::orbits
