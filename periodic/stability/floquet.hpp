#pragma once

#include <complex>
#include <vector>

#include <Eigen/Core>

#include "models/arithmetic/matrix_layout.hpp"

#pragma GCC visibility push(default)

namespace orbid::periodic {

/// Floquet multipliers: eigenvalues of X_{p-1} ... X_1 X_0 without forming the product.
///
/// Periodic Schur form: unitary Q_j with Q_{j+1}^H X_j Q_j upper triangular for all j (Q_p = Q_0). It is computed by
/// reduction of the sequence to Hessenberg-triangular form and implicitly shifted QR steps. A multiplier is the product
/// of its diagonal elements. Backward stable factor by factor: a multiplier of 1e-30 beside one of 1e+10 keeps its
/// digits, which the explicit product loses.
///
/// @param factors  X_0 .. X_{p-1}, shape (n, n) each, real, finite.
/// @return n multipliers, largest modulus first. A complex pair is exactly conjugate, positive imaginary part first;
///         real ones have imaginary part exactly 0. There are at least as many exact zeros as the largest number of
///         zero rows in a factor. (A period with sticking has a zero row: its multiplier is 0, not rounding.) Where 30
///         n QR steps do not converge, neighbouring factors are multiplied and it is tried again. Empty when the whole
///         product does not converge either (not seen).
/// @throws std::invalid_argument on an empty list, or factors that are not square, of one size and finite.
/// Cost: O(p n^3).
/// Source: A. Bojanczyk, G. H. Golub, P. Van Dooren, Proc. SPIE 1770 (1992) 31.
[[nodiscard]] std::vector<std::complex<double>> floquet_multipliers(const std::vector<Eigen::MatrixXd>& factors);

/// Takes the multiplier along the orbit of an autonomous flow, the one nearest to 1, out of a list that is not empty.
[[nodiscard]] std::complex<double> take_trivial(std::vector<std::complex<double>>& multipliers);

}  // namespace orbid::periodic

#pragma GCC visibility pop
