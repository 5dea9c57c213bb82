#include "orbits/local_maps/reference_map.hpp"

#include <algorithm>
#include <cmath>

#include "models/arithmetic/orthogonal_factor.hpp"
#include "models/arithmetic/triangular_solve.hpp"
#include "orbits/local_maps/fit_limits.hpp"
#include "orbits/local_maps/local_map.hpp"
#include "orbits/local_maps/monomials.hpp"

namespace orbid::orbits {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

// Ratio of diagonal entries of the triangular factor below which a direction of the neighbourhood is lost to rounding.
constexpr double lost_direction = 1e-11;

// Values of the monomials of the orders 2 and 3 at every row of `offsets`, shape (k, monomials), and at one place their
// slopes, shape (n, monomials).
MatrixXd curved_values(const Monomials& monomials, const MatrixXd& offsets) {
    MatrixXd result(offsets.rows(), monomials.count(3));
    monomials.evaluate_columns(offsets.data(), offsets.rows(), result.cols(), result.data());
    return result.rightCols(result.cols() - monomials.count(1));
}

MatrixXd curved_slopes(const Monomials& monomials, const VectorXd& place) {
    const Index count = monomials.count(3), straight = monomials.count(1);
    VectorXd values(count);
    monomials.evaluate(place.data(), count, values.data());
    MatrixXd result = MatrixXd::Zero(place.size(), count - straight);
    for (Index m = straight; m < count; ++m)
        for (Index a = 0; a < place.size(); ++a)
            if (const int exponent = monomials.exponent(m, a); exponent > 0)
                result(a, m - straight) += exponent * values[monomials.lowered(m, a)];
    return result;
}

// What fits with intercept leave over: curved_residual and truncation of the map.
void tell_truncation(const MatrixXd& images, ReferenceMap& map) {
    const Index k = map.offsets.rows(), n = map.offsets.cols();
    map.curved_residual = map.residual;
    const MatrixXd scaled = map.offsets / map.offsets.rowwise().norm().maxCoeff();
    const MatrixXd curved_terms = curved_values(Monomials(n, 3), scaled);
    MatrixXd design(k, 1 + n + curved_terms.cols());
    design << MatrixXd::Ones(k, 1), scaled, curved_terms;
    // Cubic terms too where the neighbours leave room for them: about a point of symmetry all truncation is cubic.
    const Index quadratic = 1 + n + n * (n + 1) / 2;
    const Index columns = k >= 2 * design.cols() ? design.cols() : quadratic;
    if (!(k >= columns + 2)) return;
    const auto mean_square_left = [&](Index used) {
        const MatrixXd part = design.leftCols(used);
        return (images - part * models::PivotedFactor(part).solve(images)).squaredNorm() /
               static_cast<double>((k - used) * n);
    };
    const double affine = mean_square_left(1 + n), curved = mean_square_left(columns);
    map.curved_residual = std::sqrt(curved);
    map.truncation = affine > 0.0 ? std::clamp(1.0 - curved / affine, 0.0, 1.0) : 0.0;
}

// Sigma that explains what curved maps with intercept leave over: every residual is e_{t+1} - A e_t of its
// neighbour.
MatrixXd estimated_reading_covariance(const std::vector<ReferenceMap>& maps) {
    const Index n = maps.front().jacobian.rows();
    double left = 0.0, gain = 0.0;
    for (const ReferenceMap& map : maps) {
        left += static_cast<double>(n) * map.curved_residual * map.curved_residual;
        gain += static_cast<double>(n) + map.jacobian.squaredNorm();
    }
    return (left / gain + scaled_rounding * scaled_rounding) * MatrixXd::Identity(n, n);
}

// Covariance of the errors of a map at d from its reference, shape (n (1 + n), n (1 + n)): value, then the columns of
// the jacobian.
MatrixXd map_covariance(const ReferenceMap& map, const VectorXd& d) {
    const Index n = d.size(), k = map.offsets.rows();
    // Truncation: random quadratic and cubic terms less what the slopes take of them. In units of the radius the cubic
    // ones count half, as in a convergent series; where neighbours lie symmetrically only they disturb the slopes.
    const double radius = map.offsets.rowwise().norm().maxCoeff();
    const Monomials monomials(n, 3);
    const Index quadratic = n * (n + 1) / 2;
    VectorXd size = VectorXd::Constant(monomials.count(3) - monomials.count(1), 0.5);
    size.head(quadratic).setOnes();
    const MatrixXd values = curved_values(monomials, map.offsets / radius) * size.asDiagonal();
    const MatrixXd taken = map.solver * values;  // by the slopes, shape (n, terms)
    MatrixXd smooth(n + 1, values.cols());
    smooth.row(0) = curved_values(monomials, d.transpose() / radius) * size.asDiagonal() - d.transpose() * taken;
    smooth.bottomRows(n) = curved_slopes(monomials, d / radius) * size.asDiagonal() / radius - taken;
    const double smooth_share = (values - map.offsets * taken).squaredNorm();
    // Reading errors: independent ones of the neighbours, and the reference's, which all offsets and images share.
    MatrixXd reading(n + 1, k + 1);
    reading.block(1, 0, n, k) = map.solver;
    reading.block(1, k, n, 1) = map.solver.rowwise().sum();
    reading.row(0) = d.transpose() * reading.bottomRows(n);

    // How the errors of the coordinates go together; this correlation of a few residuals is not believed fully, or a
    // combination would look too good.
    MatrixXd products = map.residuals.transpose() * map.residuals;
    const VectorXd squares = products.diagonal();
    products *= believed_correlation;
    products.diagonal() = squares.array() + scaled_rounding * scaled_rounding * static_cast<double>(k);
    const double total = products.trace();
    const double curved =
        (map.curved_residual * map.curved_residual + scaled_rounding * scaled_rounding) * static_cast<double>(n);
    MatrixXd shape = reading * reading.transpose() * (curved / total);
    if (smooth_share > 0.0) shape += smooth * smooth.transpose() * (map.truncation / smooth_share);
    MatrixXd result(n * (n + 1), n * (n + 1));
    for (Index a = 0; a <= n; ++a)
        for (Index b = 0; b <= n; ++b)
            result.block(a * n, b * n, n, n) = shape(a, b) * products;
    return result;
}

}  // namespace

ReferenceMap fit_reference_map(const SectionPoints& section, const NeighbourIndex& grid, std::size_t reference,
                               double ball, std::size_t most) {
    const Index n = section.dimension();
    const double* const x = section.point(reference);
    const double* const image = section.point(reference + 1);
    // One more for the reference, which is its own nearest neighbour.
    const std::vector<Neighbour> found = grid.nearest(Eigen::Map<const VectorXd>(x, n), most + 1);
    ReferenceMap map;
    map.offsets.resize(static_cast<Index>(found.size()), n);
    MatrixXd images(static_cast<Index>(found.size()), n);
    VectorXd times(section.timed() ? static_cast<Index>(found.size()) : 0);
    Index k = 0;
    for (const Neighbour& neighbour : found) {
        if (neighbour.index == reference && !neighbour.mirrored) continue;
        if (k == static_cast<Index>(most) || !(neighbour.distance2 <= ball * ball)) break;
        bool whole = true;
        for (Index d = 0; d < n; ++d) {
            const double sign = neighbour.mirrored ? section.signs()[d] : 1.0;
            map.offsets(k, d) = section.difference(sign * section.point(neighbour.index)[d], x[d], d);
            images(k, d) = section.difference(sign * section.point(neighbour.index + 1)[d], image[d], d);
            if (section.is_angle(d) && !(std::abs(images(k, d)) < torn_turns)) whole = false;
        }
        if (!whole) break;
        if (section.timed()) times[k] = section.return_time(neighbour.index) - section.return_time(reference);
        ++k;
    }
    map.offsets.conservativeResize(k, n);
    images.conservativeResize(k, n);
    if (k < n + 2) return map;
    const models::PivotedFactor factor(map.offsets);
    const MatrixXd& triangle = factor.packed();
    if (!(std::abs(triangle(n - 1, n - 1)) > lost_direction * std::abs(triangle(0, 0)))) return map;
    // Thin factors only: all points of a ball can be thousands.
    MatrixXd basis = MatrixXd::Identity(k, n);
    factor.apply_q(basis);
    MatrixXd solved = basis.transpose();
    models::solve_upper_in_place(triangle.topRows(n), solved);
    map.solver = factor.permuted(solved);
    map.jacobian = (map.solver * images).transpose();
    if (!map.jacobian.allFinite()) return map;
    map.residuals = images - map.offsets * map.jacobian.transpose();
    map.residual = std::sqrt(map.residuals.squaredNorm() / static_cast<double>((k - n) * n));
    map.image_spread =
        std::sqrt((images.rowwise() - images.colwise().mean()).squaredNorm() / static_cast<double>((k - 1) * n));
    tell_truncation(images, map);
    if (section.timed()) {
        map.return_time = section.return_time(reference);
        map.time_slope = map.solver * times.head(k);
        map.time_residual =
            (times.head(k) - map.offsets * map.time_slope).norm() / std::sqrt(static_cast<double>(k - n));
    }
    map.usable = true;
    return map;
}

ReferenceErrors reference_errors(const std::vector<ReferenceMap>& maps, const VectorXd& offset, const MatrixXd& inverse,
                                 const MatrixXd& reading_covariance) {
    const Index n = maps.front().jacobian.rows(), p = static_cast<Index>(maps.size());
    std::vector<MatrixXd> jacobians;
    for (const ReferenceMap& map : maps)
        jacobians.push_back(map.jacobian);
    ReferenceErrors result;
    result.multipliers = cycle_multipliers(jacobians);

    // dx_{j+1} - A_j dx_j = e_{j+1} - A_j e_j, and where the piece closes dx_0 = e_p + A (dx_{p-1} - e_{p-1}).
    MatrixXd steps = MatrixXd::Zero(n * p, n * (p + 1));
    for (Index j = 0; j < p; ++j) {
        steps.block(j * n, j * n, n, n) = -jacobians[static_cast<std::size_t>(j)];
        steps.block(j * n, (j + 1) * n, n, n).setIdentity();
    }
    const MatrixXd by_readings = -inverse * steps;
    const MatrixXd sigma = reading_covariance.size() > 0 ? reading_covariance : estimated_reading_covariance(maps);
    result.covariance = MatrixXd::Zero(n * p, n * p);
    for (Index j = 0; j <= p; ++j)
        result.covariance += by_readings.middleCols(j * n, n) * sigma * by_readings.middleCols(j * n, n).transpose();

    const MatrixXd derivative = ln_multiplier_derivative(jacobians);
    result.ln_multiplier_covariance = MatrixXd::Zero(n, n);
    for (Index j = 0; j < p; ++j) {
        const MatrixXd errors = map_covariance(maps[static_cast<std::size_t>(j)], offset.segment(j * n, n));
        const MatrixXd to_points = inverse.middleCols(j * n, n);
        const MatrixXd to_multipliers = derivative.middleCols(j * n * n, n * n);
        result.covariance += to_points * errors.topLeftCorner(n, n) * to_points.transpose();
        result.ln_multiplier_covariance +=
            to_multipliers * errors.bottomRightCorner(n * n, n * n) * to_multipliers.transpose();
    }
    if (maps.front().time_slope.size() > 0) {
        // The return times' own errors are taken as large as the neighbours' residuals: at most, for the cycle lies
        // nearer to the reference than they do.
        VectorXd slope(n * p);
        double variance = 0.0;
        for (Index j = 0; j < p; ++j) {
            const ReferenceMap& map = maps[static_cast<std::size_t>(j)];
            slope.segment(j * n, n) = map.time_slope;
            variance += map.time_residual * map.time_residual;
        }
        result.time_sd = std::sqrt(variance + slope.dot(result.covariance * slope));
    }
    result.covariance = floored_covariance(result.covariance);
    result.ln_multiplier_covariance = floored_covariance(result.ln_multiplier_covariance);
    return result;
}

}  // namespace orbid::orbits
