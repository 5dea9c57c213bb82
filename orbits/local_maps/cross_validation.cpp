#include "orbits/local_maps/cross_validation.hpp"

#include <cmath>
#include <vector>

#include "models/arithmetic/cholesky_factor.hpp"
#include "orbits/local_maps/fit_limits.hpp"
#include "orbits/local_maps/monomials.hpp"

namespace orbid::orbits {

namespace {

// Directions without spread (thin neighbourhoods of clean data) are not extrapolated along: part of the mean diagonal
// of the normal matrix added to it.
constexpr double ridge = 1e-10;

// The weight function vanishes at this multiple of the farthest neighbour's squared distance.
constexpr double margin = 1.1;

// Monomials of orders 0 to `order` of t, order by order, into one row.
void fill_monomials(const Eigen::VectorXd& t, int order, Eigen::VectorXd& row) {
    const Eigen::Index n = t.size();
    row[0] = 1.0;
    Eigen::Index at = 1;
    for (Eigen::Index a = 0; a < n; ++a)
        row[at++] = t[a];
    if (order < 2) return;
    for (Eigen::Index a = 0; a < n; ++a)
        for (Eigen::Index b = a; b < n; ++b)
            row[at++] = t[a] * t[b];
    if (order < 3) return;
    for (Eigen::Index a = 0; a < n; ++a)
        for (Eigen::Index b = a; b < n; ++b)
            for (Eigen::Index c = b; c < n; ++c)
                row[at++] = t[a] * t[b] * t[c];
}

}  // namespace

CrossValidation held_out_fit(const SectionPoints& points, const NeighbourIndex& grid, std::size_t t, int order,
                             std::size_t k) {
    const Eigen::Index n = points.dimension(), coefficients = coefficient_count(n, order);
    const Eigen::VectorXd centre = Eigen::Map<const Eigen::VectorXd>(points.point(t), n);
    const Eigen::VectorXd image = Eigen::Map<const Eigen::VectorXd>(points.point(t + 1), n);
    const std::vector<Neighbour> members = grid.nearest(centre, k + (points.symmetric() ? 2 : 1));
    CrossValidation fit;
    if (members.empty()) return fit;
    const double radius2 = margin * members.back().distance2;
    if (!(radius2 > 0.0)) return fit;
    const double radius = std::sqrt(radius2);
    const auto rows = static_cast<Eigen::Index>(members.size());
    Eigen::MatrixXd design(rows, coefficients), images(rows, n);
    Eigen::VectorXd weights(rows), offset(n), row(coefficients);
    Eigen::Index kept = 0;
    for (const Neighbour& member : members) {
        if (member.index == t) continue;
        const double* x = points.point(member.index);
        const double* y = points.point(member.index + 1);
        bool whole = true;
        for (Eigen::Index d = 0; d < n; ++d) {
            const double sign = member.mirrored ? points.signs()[d] : 1.0;
            offset[d] = points.difference(sign * x[d], centre[d], d) / radius;
            images(kept, d) = points.difference(sign * y[d], image[d], d);
            if (points.angle()[static_cast<std::size_t>(d)] && !(std::abs(images(kept, d)) < torn_turns)) whole = false;
        }
        if (!whole) return fit;
        const double w = 1.0 - member.distance2 / radius2;
        weights[kept] = w * w;
        fill_monomials(offset, order, row);
        design.row(kept++) = row;
    }
    if (kept < coefficients + 2) return fit;
    const auto used = Eigen::seqN(0, kept);
    const Eigen::MatrixXd x = design(used, Eigen::all), y = images(used, Eigen::all);
    const Eigen::VectorXd w = weights.head(kept);
    Eigen::MatrixXd normal = x.transpose() * w.asDiagonal() * x;
    normal.diagonal().array() += ridge * normal.trace() / static_cast<double>(coefficients);
    const models::CholeskyFactor factor(normal);
    if (!factor.positive_definite()) return fit;
    // Row by row, the order in which Eigen takes this product for itself: by columns it rounds differently.
    using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
    const RowMajor right = x.transpose() * (w.asDiagonal() * y);
    const Eigen::MatrixXd solution = factor.solve(right);
    const Eigen::MatrixXd left = y - x * solution;
    const double total = w.sum();
    // Of the kept points' weights the fit uses up as much as unweighted points would of their number.
    const double freedom = 1.0 - static_cast<double>(coefficients) / static_cast<double>(kept);
    fit.residual = -solution.row(0).transpose();
    fit.gradient = solution.middleRows(1, n).transpose() / radius;
    fit.covariance = left.transpose() * w.asDiagonal() * left / (total * freedom);
    fit.covariance.diagonal().array() += rounding_variance;
    fit.usable = fit.residual.allFinite() && fit.gradient.allFinite() && fit.covariance.allFinite();
    return fit;
}

}  // namespace orbid::orbits
