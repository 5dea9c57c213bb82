#pragma once

#include "periodic/orbit/eigen_names.hpp"

namespace orbid::periodic {

/// Gauss's implicit Runge-Kutta method with m stages: collocation at the zeros c_i of the Legendre polynomial on [0,
/// 1]. Integrates polynomials of degree 2 m - 1 exactly; order 2 m. Source: E. Hairer, S. P. Norsett, G. Wanner,
/// Solving Ordinary Differential Equations I (1993), section II.7.
struct GaussMethod {
    VectorXd nodes;    ///< c, ascending, shape (m)
    MatrixXd matrix;   ///< a_ij = integral of l_j over [0, c_i], l_j Lagrange's polynomials on c
    VectorXd weights;  ///< b_j = integral of l_j over [0, 1]

    /// Integrals of l_j over [0, u], shape (m).
    [[nodiscard]] VectorXd integrals(double u) const;
    /// d^(m-1) l_j / du^(m-1), a constant: shape (m).
    [[nodiscard]] VectorXd highest_derivatives() const;
};

/// @param stages  m in [1, 10].
/// @throws std::invalid_argument otherwise.
[[nodiscard]] GaussMethod gauss_method(int stages);

}  // namespace orbid::periodic
