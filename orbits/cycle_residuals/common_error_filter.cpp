#include "orbits/cycle_residuals/common_error_filter.hpp"

#include "models/arithmetic/cholesky_factor.hpp"

namespace orbid::orbits {

using Eigen::MatrixXd;

CommonErrorStep CommonErrorFilter::next(const MatrixXd& common, const MatrixXd& own, bool told) {
    CommonErrorStep step;
    const MatrixXd spread = common * left_;  // G P
    step.shape = own + spread * common.transpose();
    step.shape = MatrixXd(0.5 * (step.shape + step.shape.transpose()));
    if (!told) return step;
    const models::CholeskyFactor factor(step.shape);
    MatrixXd half = spread;  // L^-1 G P
    factor.solve_lower_in_place(half);
    step.gain = factor.solve(spread).transpose();
    left_ -= half.transpose() * half;
    return step;
}

}  // namespace orbid::orbits
