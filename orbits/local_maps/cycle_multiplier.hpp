#pragma once

#include <complex>
#include <vector>

#include <Eigen/Core>

namespace orbid::orbits {

/// Multipliers of a product of one-step Jacobians A_{p-1} ... A_0 (P6), and ln of their moduli.
struct CycleMultipliers {
    std::vector<std::complex<double>> values;  ///< largest modulus first; conjugates: positive imaginary part first
    Eigen::VectorXd ln_modulus;                ///< same order; -inf for a zero multiplier
};

/// Multipliers without forming the product where they are real: orthogonal iteration around the cycle, so that small
/// ones keep their digits. It does not converge for complex pairs and equal moduli, which come from the product.
///
/// @param jacobians  p >= 1 square matrices, shape (n, n), in the order of the points.
[[nodiscard]] CycleMultipliers cycle_multipliers(const std::vector<Eigen::MatrixXd>& jacobians);

/// d ln|multipliers| / d (entries of A_0, A_1, ..., each column by column), by central differences, shape (n, p n n).
/// Zero where a multiplier is zero to rounding and has no logarithm.
[[nodiscard]] Eigen::MatrixXd ln_multiplier_derivative(const std::vector<Eigen::MatrixXd>& jacobians);

}  // namespace orbid::orbits
