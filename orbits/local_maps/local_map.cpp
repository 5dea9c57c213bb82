#include "orbits/local_maps/local_map.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "models/arithmetic/eigenvalues.hpp"
#include "models/arithmetic/triangular_solve.hpp"
#include "orbits/local_maps/fit_limits.hpp"

namespace orbid::orbits {

Neighbourhood gather_neighbourhood(const SectionPoints& points, const NeighbourIndex& grid,
                                   const Eigen::VectorXd& centre, std::size_t k) {
    const Eigen::Index n = points.dimension();
    Neighbourhood result;
    result.centre = points.wrapped(centre);
    result.members = grid.nearest(result.centre, k);
    result.offsets.resize(static_cast<Eigen::Index>(result.members.size()), n);
    result.images.resize(static_cast<Eigen::Index>(result.members.size()), n);
    result.reference = Eigen::VectorXd::Zero(n);
    Eigen::Index kept = 0;
    for (const Neighbour& member : result.members) {
        const double* x = points.point(member.index);
        const double* image = points.point(member.index + 1);
        bool whole = true;
        for (Eigen::Index d = 0; d < n; ++d) {
            const double sign = member.mirrored ? points.signs()[d] : 1.0;
            if (kept == 0) result.reference[d] = sign * image[d];
            result.offsets(kept, d) = points.difference(sign * x[d], result.centre[d], d);
            result.images(kept, d) = points.difference(sign * image[d], result.reference[d], d);
            if (points.is_angle(d) && !(std::abs(result.images(kept, d)) < torn_turns)) whole = false;
        }
        if (!whole) break;
        ++kept;
    }
    result.offsets.conservativeResize(kept, n);
    result.images.conservativeResize(kept, n);
    result.members.resize(static_cast<std::size_t>(kept));
    if (kept > 0) result.radius = radius_margin * std::sqrt(result.members.back().distance2);
    return result;
}

Eigen::VectorXd LocalMap::displacement(const Eigen::VectorXd& d) const {
    const Eigen::Index count = coefficients.cols();
    const Eigen::VectorXd t = d / radius;
    Eigen::VectorXd values(count);
    monomials->evaluate(t.data(), count, values.data());
    return coefficients.rightCols(count - 1) * values.tail(count - 1);
}

Eigen::MatrixXd LocalMap::jacobian_at(const Eigen::VectorXd& d) const {
    const Eigen::Index count = coefficients.cols(), n = d.size();
    const Eigen::VectorXd t = d / radius;
    Eigen::VectorXd values(count);
    monomials->evaluate(t.data(), count, values.data());
    Eigen::MatrixXd result = Eigen::MatrixXd::Zero(n, n);
    for (Eigen::Index i = 1; i < count; ++i)
        for (Eigen::Index a = 0; a < n; ++a)
            if (const int exponent = monomials->exponent(i, a); exponent > 0)
                result.col(a) += coefficients.col(i) * (exponent * values[monomials->lowered(i, a)] / radius);
    return result;
}

LocalMap fit_local_map(const SectionPoints& points, const Neighbourhood& neighbourhood, int order, std::size_t k,
                       const std::shared_ptr<const Monomials>& monomials, PolynomialFit& workspace) {
    const auto rows = static_cast<std::size_t>(neighbourhood.offsets.rows());
    LocalMap map;
    map.centre = neighbourhood.centre;
    map.order = order;
    // Neighbourhoods that were made up of places alone have no list of members.
    map.radius = k < rows ? radius_margin * neighbourhood.offsets.row(static_cast<Eigen::Index>(k) - 1).norm()
                          : neighbourhood.radius;
    if (!workspace.fit(*monomials, order, neighbourhood.offsets, neighbourhood.images,
                       static_cast<Eigen::Index>(std::min(k, rows)), map.radius))
        return map;
    const Eigen::Index n = neighbourhood.offsets.cols();
    map.coefficients = workspace.coefficients().transpose();
    map.monomials = monomials;
    map.residual = workspace.residual();
    map.left_out = workspace.left_out();
    map.value_sd = map.left_out * std::sqrt(workspace.leverage());
    if (monomials->highest() >= order + 2) {
        workspace.part_residuals(*monomials);
        map.value_sd = std::sqrt(workspace.value_variance());
    }
    map.image_spread = workspace.spread();
    map.value = points.wrapped(neighbourhood.reference + map.coefficients.col(0));
    map.jacobian = map.coefficients.middleCols(1, n) / map.radius;
    map.usable = true;
    return map;
}

Eigen::MatrixXd local_map_covariance(const Neighbourhood& neighbourhood, const LocalMap& map, std::size_t most) {
    const bool all = most >= neighbourhood.members.size();
    const Eigen::Index k = all ? neighbourhood.offsets.rows() : static_cast<Eigen::Index>(most);
    const Eigen::Index n = neighbourhood.offsets.cols();
    const double radius =
        all ? neighbourhood.radius : radius_margin * std::sqrt(neighbourhood.members[most - 1].distance2);
    const int order = map.order;
    const Monomials monomials(n, order + 2);
    PolynomialFit fit;
    if (!fit.fit(monomials, order, neighbourhood.offsets, neighbourhood.images, k, radius))
        return Eigen::MatrixXd::Constant(n * (n + 1), n * (n + 1), std::numeric_limits<double>::infinity());
    fit.part_residuals(monomials);
    const Eigen::VectorXd& weight = fit.root_weights();
    // shape (1 + n, k): value and jacobian from weighted images; units of the jacobian: per radius
    Eigen::VectorXd unit = Eigen::VectorXd::Constant(n + 1, 1.0 / radius);
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
    const Eigen::MatrixXd offsets = neighbourhood.offsets.topRows(k);
    const double spread =
        weight.cwiseProduct(offsets.rowwise().norm()).squaredNorm() / (weight.squaredNorm() * static_cast<double>(n));
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

Eigen::MatrixXd floored_covariance(const Eigen::MatrixXd& covariance) {
    // Relative to the largest eigenvalue: bounds the condition number.
    constexpr double relative_floor = 1e-9;
    Eigen::MatrixXd result = 0.5 * (covariance + covariance.transpose());
    const double largest = std::max(0.0, models::symmetric_eigenvalues(result).maxCoeff());
    result.diagonal().array() += relative_floor * largest + rounding_variance;
    return result;
}

}  // namespace orbid::orbits
