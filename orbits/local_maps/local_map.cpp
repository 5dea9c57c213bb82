#include "orbits/local_maps/local_map.hpp"

#include <algorithm>
#include <cmath>

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
            if (points.angle()[static_cast<std::size_t>(d)] && !(std::abs(result.images(kept, d)) < torn_turns))
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

Neighbourhood nearest_part(const Neighbourhood& neighbourhood, std::size_t k) {
    if (k >= neighbourhood.members.size()) return neighbourhood;
    Neighbourhood result;
    result.centre = neighbourhood.centre;
    result.reference = neighbourhood.reference;
    result.offsets = neighbourhood.offsets.topRows(static_cast<Eigen::Index>(k));
    result.images = neighbourhood.images.topRows(static_cast<Eigen::Index>(k));
    result.members.assign(neighbourhood.members.begin(),
                          neighbourhood.members.begin() + static_cast<std::ptrdiff_t>(k));
    result.radius = k > 0 ? radius_margin * std::sqrt(result.members.back().distance2) : 0.0;
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

LocalMap fit_local_map(const SectionPoints& points, const Neighbourhood& neighbourhood, int order) {
    PolynomialFit workspace;
    return fit_local_map(points, neighbourhood, order, static_cast<std::size_t>(neighbourhood.offsets.rows()),
                         std::make_shared<const Monomials>(neighbourhood.centre.size(), order), workspace);
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

}  // namespace orbid::orbits
