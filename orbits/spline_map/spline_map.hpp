#pragma once

#include <utility>
#include <vector>

#include <Eigen/Core>

#include "orbits/spline_map/spline_basis.hpp"

namespace orbid::orbits {

/// A map at a place, with derivatives, in scaled units.
struct MapValue {
    bool inside = false;                   ///< data near enough
    Eigen::VectorXd displacement;          ///< F(x) - x, shape (n), angles lifted
    Eigen::MatrixXd jacobian;              ///< dF/dx, shape (n, n)
    std::vector<Eigen::MatrixXd> bending;  ///< second derivatives of every coordinate, shape (n, n); empty unless asked
    SplineSupport support;
};

/// One smooth map over a whole section:  F(x) = x + offset + sum over patches of value(x) coefficient.
class SplineMap {
public:
    /// @param offset  shape (n): SectionLift::offset.
    SplineMap(SplineBasis basis, Eigen::VectorXd offset, Eigen::VectorXd signs)
        : basis_(std::move(basis)),
          offset_(std::move(offset)),
          signs_(std::move(signs)),
          coefficients_(Eigen::VectorXd::Zero(basis_.unknowns())) {}

    [[nodiscard]] const SplineBasis& basis() const { return basis_; }
    [[nodiscard]] const Eigen::VectorXd& offset() const { return offset_; }
    [[nodiscard]] const Eigen::VectorXd& coefficients() const { return coefficients_; }  ///< patch * n + coordinate
    void set_coefficients(Eigen::VectorXd coefficients) { coefficients_ = std::move(coefficients); }

    /// @param derivatives  1, or 2 for the bending too.
    void evaluate(const double* place, int derivatives, MapValue& result) const;

    /// Sign that coordinate d of a coefficient takes where its patch is used as its mirror image.
    [[nodiscard]] double sign(bool mirrored, Eigen::Index d) const { return mirrored ? signs_[d] : 1.0; }

private:
    SplineBasis basis_;
    Eigen::VectorXd offset_;
    Eigen::VectorXd signs_;  ///< empty: no symmetry
    Eigen::VectorXd coefficients_;
};

inline void SplineMap::evaluate(const double* place, int derivatives, MapValue& result) const {
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
