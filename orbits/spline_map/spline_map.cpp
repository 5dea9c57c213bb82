#include "orbits/spline_map/spline_map.hpp"

namespace orbid::orbits {

void SplineMap::evaluate(const double* place, int derivatives, MapValue& result) const {
    basis_.support(place, derivatives, result.support);
    result.inside = result.support.inside;
    if (!result.inside) return;
    const Eigen::Index n = basis_.dimension();
    result.displacement = offset_;
    result.jacobian.setIdentity(n, n);
    if (derivatives > 1) result.bending.assign(static_cast<std::size_t>(n), Eigen::MatrixXd::Zero(n, n));
    for (std::size_t f = 0; f < result.support.patch.size(); ++f) {
        const auto column = static_cast<Eigen::Index>(f);
        for (Eigen::Index d = 0; d < n; ++d) {
            const double coefficient =
                sign(result.support.mirrored[f] != 0, d) * coefficients_[result.support.patch[f] * n + d];
            result.displacement[d] += coefficient * result.support.value[column];
            result.jacobian.row(d) += coefficient * result.support.slope.col(column).transpose();
            if (derivatives > 1) result.bending[static_cast<std::size_t>(d)] += coefficient * result.support.bending[f];
        }
    }
}

}  // namespace orbid::orbits
