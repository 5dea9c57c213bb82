#include "orbits/local_map.hpp"

#include <algorithm>
#include <cmath>

#include <Eigen/QR>

namespace orbid::orbits {

namespace {

// Images this far (in turns) from the nearest neighbour's image have no unique representative any more.
constexpr double torn = 0.25;

// The weight function vanishes at the radius: this much beyond the farthest neighbour, so that it still counts.
constexpr double radius_margin = 1.05;

// Ratio of diagonal entries of the triangular factor below which a direction of the neighbourhood is lost to rounding.
constexpr double lost_rank = 1e-11;

// Independent errors never fall below the rounding of scaled coordinates of order one, with room for the few digits
// that simulation and reading lose.
constexpr double rounding = 1e-14;

// Columns 1, d_a, d_a d_b (a <= b), ... of all orders from `lowest` to `highest`, in units of the radius.
Eigen::MatrixXd monomials(const Eigen::MatrixXd& offsets, double radius, int lowest, int highest) {
    const Eigen::Index k = offsets.rows(), n = offsets.cols();
    const Eigen::MatrixXd t = offsets / radius;
    struct Term {
        Eigen::VectorXd value;
        Eigen::Index last;  // products continue with coordinates from here on, so that each monomial occurs once
    };
    std::vector<Term> terms{{Eigen::VectorXd::Ones(k), 0}};
    std::vector<Eigen::VectorXd> columns;
    for (int order = 0; order <= highest; ++order) {
        if (order > 0) {
            std::vector<Term> next;
            for (const Term& term : terms)
                for (Eigen::Index d = term.last; d < n; ++d)
                    next.push_back({term.value.cwiseProduct(t.col(d)), d});
            terms = std::move(next);
        }
        if (order >= lowest)
            for (const Term& term : terms)
                columns.push_back(term.value);
    }
    Eigen::MatrixXd result(k, static_cast<Eigen::Index>(columns.size()));
    for (std::size_t c = 0; c < columns.size(); ++c)
        result.col(static_cast<Eigen::Index>(c)) = columns[c];
    return result;
}

// Square roots of the weights.
Eigen::VectorXd root_weights(const Neighbourhood& neighbourhood) {
    const Eigen::VectorXd ratio2 =
        neighbourhood.offsets.rowwise().squaredNorm() / (neighbourhood.radius * neighbourhood.radius);
    return (1.0 - ratio2.array()).matrix();
}

}  // namespace

Neighbourhood gather_neighbourhood(const SectionPoints& points, const BoxGrid& grid, const Eigen::VectorXd& centre,
                                   std::size_t k) {
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
            if (points.angle()[static_cast<std::size_t>(d)] && !(std::abs(result.images(kept, d)) < torn))
                whole = false;
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

Eigen::Index coefficient_count(Eigen::Index n, int order) {
    Eigen::Index count = 1;
    for (int i = 1; i <= order; ++i)
        count = count * (n + i) / i;
    return count;
}

Eigen::VectorXd LocalMap::displacement(const Eigen::VectorXd& d) const {
    Eigen::VectorXd result = jacobian * d;
    if (quadratic.size() == 0) return result;
    Eigen::Index column = 0;
    for (Eigen::Index a = 0; a < d.size(); ++a)
        for (Eigen::Index b = a; b < d.size(); ++b)
            result += quadratic.col(column++) * (d[a] * d[b]);
    return result;
}

Eigen::MatrixXd LocalMap::jacobian_at(const Eigen::VectorXd& d) const {
    Eigen::MatrixXd result = jacobian;
    if (quadratic.size() == 0) return result;
    Eigen::Index column = 0;
    for (Eigen::Index a = 0; a < d.size(); ++a)
        for (Eigen::Index b = a; b < d.size(); ++b) {
            result.col(a) += quadratic.col(column) * d[b];
            result.col(b) += quadratic.col(column++) * d[a];
        }
    return result;
}

LocalMap fit_local_map(const SectionPoints& points, const Neighbourhood& neighbourhood, int order) {
    const Eigen::Index k = neighbourhood.offsets.rows(), n = neighbourhood.offsets.cols();
    const Eigen::Index coefficients = coefficient_count(n, order);
    LocalMap map;
    map.centre = neighbourhood.centre;
    map.radius = neighbourhood.radius;
    if (k < coefficients + 2 || !(neighbourhood.radius > 0.0)) return map;

    const Eigen::VectorXd weight = root_weights(neighbourhood);
    const Eigen::MatrixXd design =
        weight.asDiagonal() * monomials(neighbourhood.offsets, neighbourhood.radius, 0, order);
    const Eigen::MatrixXd response = weight.asDiagonal() * neighbourhood.images;
    const Eigen::ColPivHouseholderQR<Eigen::MatrixXd> factor(design);
    const auto& triangle = factor.matrixQR();
    if (!(std::abs(triangle(coefficients - 1, coefficients - 1)) > lost_rank * std::abs(triangle(0, 0)))) return map;
    const Eigen::MatrixXd fitted = factor.solve(response);  // shape (coefficients, n)
    if (!fitted.allFinite()) return map;

    const double total = weight.squaredNorm();
    const double freedom = static_cast<double>(k - coefficients) / static_cast<double>(k);
    map.residual = std::sqrt((response - design * fitted).squaredNorm() / (total * freedom * static_cast<double>(n)));
    const Eigen::RowVectorXd mean = weight.transpose() * response / total;
    map.image_spread = std::sqrt((response - weight * mean).squaredNorm() / (total * static_cast<double>(n)));
    map.value = points.wrapped(neighbourhood.reference + fitted.row(0).transpose());
    map.jacobian = fitted.middleRows(1, n).transpose() / neighbourhood.radius;
    if (order > 1)
        map.quadratic =
            fitted.bottomRows(coefficients - 1 - n).transpose() / (neighbourhood.radius * neighbourhood.radius);
    map.usable = true;
    return map;
}

Eigen::MatrixXd local_map_covariance(const Neighbourhood& neighbourhood, const LocalMap& map) {
    const Eigen::Index k = neighbourhood.offsets.rows(), n = neighbourhood.offsets.cols();
    const int order = map.quadratic.size() == 0 ? 1 : 2;
    const Eigen::VectorXd weight = root_weights(neighbourhood);
    const Eigen::MatrixXd design =
        weight.asDiagonal() * monomials(neighbourhood.offsets, neighbourhood.radius, 0, order);
    const Eigen::MatrixXd response = weight.asDiagonal() * neighbourhood.images;
    const Eigen::Index coefficients = design.cols();
    const Eigen::ColPivHouseholderQR<Eigen::MatrixXd> factor(design);
    // Thin factors only: neighbourhoods of thousands must not need matrices of k x k.
    const Eigen::MatrixXd basis = factor.householderQ() * Eigen::MatrixXd::Identity(k, coefficients);
    const Eigen::MatrixXd solver =  // shape (coefficients, k): coefficients from weighted images
        factor.colsPermutation() * factor.matrixQR()
                                       .topRows(coefficients)
                                       .triangularView<Eigen::Upper>()
                                       .solve(Eigen::MatrixXd(basis.transpose()));
    const Eigen::MatrixXd residual = response - basis * (basis.transpose() * response);  // shape (k, n)

    // Independent errors of equal size per image: weighted, they are no longer equal. What the fit leaves of them is
    // |(1 - P) W|^2 = tr W (1 - P) W with the projector P = basis basis^T.
    const Eigen::MatrixXd independent = solver.topRows(n + 1) * weight.asDiagonal();
    const double independent_share = weight.cwiseAbs2().dot((1.0 - basis.rowwise().squaredNorm().array()).matrix());
    // The next two orders; the second of them counts less, as in a convergent series.
    Eigen::MatrixXd remainder = monomials(neighbourhood.offsets, neighbourhood.radius, order + 1, order + 2);
    const Eigen::Index next = coefficient_count(n, order + 1) - coefficients;
    remainder.rightCols(remainder.cols() - next) *= 0.5;
    const Eigen::MatrixXd weighted_remainder = weight.asDiagonal() * remainder;
    const Eigen::MatrixXd smooth = solver.topRows(n + 1) * weighted_remainder;
    const double smooth_share = (weighted_remainder - basis * (basis.transpose() * weighted_remainder)).squaredNorm();

    // Sum of squares and products of the residuals; the coordinates' errors are correlated, but the correlation of a
    // few effective residuals is not believed fully, or a combination would look too good.
    Eigen::MatrixXd products = residual.transpose() * residual;
    const Eigen::VectorXd squares = products.diagonal();
    products = 0.9 * products;
    products.diagonal() = squares.array() + rounding * rounding * static_cast<double>(k);

    Eigen::MatrixXd shape = independent * independent.transpose() / independent_share;
    if (smooth_share > 0.0) shape += smooth * smooth.transpose() / smooth_share;
    // units of the jacobian: per radius
    Eigen::VectorXd unit = Eigen::VectorXd::Constant(n + 1, 1.0 / neighbourhood.radius);
    unit[0] = 1.0;
    shape = unit.asDiagonal() * shape * unit.asDiagonal();

    Eigen::MatrixXd result(n * (n + 1), n * (n + 1));
    for (Eigen::Index a = 0; a <= n; ++a)
        for (Eigen::Index b = 0; b <= n; ++b)
            result.block(a * n, b * n, n, n) = shape(a, b) * products;

    // Errors in variables: residual = error of the image - A error of the place.
    const double place_variance =
        map.residual * map.residual / (1.0 + map.jacobian.squaredNorm() / static_cast<double>(n));
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
            const double shift = map.quadratic.row(row).cwiseAbs().sum() * place_variance;
            result(row, row) += shift * shift;
        }
    return result;
}

}  // namespace orbid::orbits
