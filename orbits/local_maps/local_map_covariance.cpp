#include <algorithm>
#include <cmath>
#include <limits>

#include "models/arithmetic/triangular_solve.hpp"
#include "orbits/local_maps/fit_limits.hpp"
#include "orbits/local_maps/local_map.hpp"

namespace orbid::orbits {

Eigen::MatrixXd local_map_covariance(const Neighbourhood& neighbourhood, const LocalMap& map) {
    const Eigen::Index k = neighbourhood.offsets.rows(), n = neighbourhood.offsets.cols();
    const int order = map.order;
    const Monomials monomials(n, order + 2);
    PolynomialFit fit;
    if (!fit.fit(monomials, order, neighbourhood.offsets, neighbourhood.images, k, neighbourhood.radius))
        return Eigen::MatrixXd::Constant(n * (n + 1), n * (n + 1), std::numeric_limits<double>::infinity());
    fit.part_residuals(monomials);
    const Eigen::VectorXd& weight = fit.root_weights();
    // shape (1 + n, k): value and jacobian from weighted images; units of the jacobian: per radius
    Eigen::VectorXd unit = Eigen::VectorXd::Constant(n + 1, 1.0 / neighbourhood.radius);
    unit[0] = 1.0;
    Eigen::MatrixXd solver = fit.basis().transpose();
    models::solve_upper_in_place(fit.triangle(), solver);
    const Eigen::MatrixXd independent = unit.asDiagonal() * solver.topRows(n + 1) * weight.asDiagonal();
    const Eigen::MatrixXd smooth = unit.asDiagonal() * fit.remainder_response().topRows(n + 1);
    const Eigen::MatrixXd independent_shape = independent * independent.transpose();
    const Eigen::MatrixXd smooth_shape = smooth * smooth.transpose();
    // The coordinates' errors are correlated, but the correlation of a few effective residuals is not believed fully,
    // or a combination would look too good.
    Eigen::MatrixXd errors = believed_correlation * fit.independent();
    errors.diagonal() = fit.independent().diagonal().array() + scaled_rounding * scaled_rounding;

    Eigen::MatrixXd result(n * (n + 1), n * (n + 1));
    for (Eigen::Index a = 0; a <= n; ++a)
        for (Eigen::Index b = 0; b <= n; ++b)
            result.block(a * n, b * n, n, n) = independent_shape(a, b) * errors + smooth_shape(a, b) * fit.remainder();

    // Errors in variables: residual = error of the image - A error of the place.
    const double place_variance = fit.independent().trace() / static_cast<double>(n) /
                                  (1.0 + map.jacobian.squaredNorm() / static_cast<double>(n));
    const double spread = weight.cwiseProduct(neighbourhood.offsets.rowwise().norm()).squaredNorm() /
                          (weight.squaredNorm() * static_cast<double>(n));
    const double attenuation = std::min(1.0, place_variance / spread);
    for (Eigen::Index a = 0; a < n; ++a)
        for (Eigen::Index row = 0; row < n; ++row) {
            const double shift = attenuation * map.jacobian(row, a);
            result(n + a * n + row, n + a * n + row) += shift * shift;
        }
    if (order > 1)
        for (Eigen::Index row = 0; row < n; ++row) {
            const double shift = map.coefficients.row(row).segment(n + 1, monomials.count(2) - n - 1).cwiseAbs().sum() *
                                 place_variance / (map.radius * map.radius);
            result(row, row) += shift * shift;
        }
    return result;
}

}  // namespace orbid::orbits
