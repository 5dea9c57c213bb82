#pragma once

#include <complex>
#include <vector>

#include "periodic/orbit/eigen_names.hpp"

namespace orbid::periodic {

/// Eigenvectors of the monodromy matrix X_{p-1} .. X_0 for one of its eigenvalues, at all points at once.
struct FloquetVectors {
    /// v_j, shape (n, p): v_{j+1} = X_j v_j / rho_j with rho_0 = mu^(1/p) times mu's phase, rho_j = |mu|^(1/p)
    /// otherwise.
    Eigen::MatrixXcd right;
    Eigen::MatrixXcd left;  ///< w_j, shape (n, p): w_j^T = w_{j+1}^T X_j / rho_j (transposed, not conjugate)
    std::vector<std::complex<double>> rho;
};

/// By inverse iteration on the cyclic matrix v_{j+1} - X_j v_j / rho_j, whose null vector they are. Expanding and
/// contracting directions keep their digits, unlike with powers of the monodromy matrix.
///
/// @param factors     X_0 .. X_{p-1}, shape (n, n) each, real, finite.
/// @param multiplier  not 0, an eigenvalue to about 1e-8.
/// Cost: O(p n^3).
[[nodiscard]] FloquetVectors floquet_vectors(const std::vector<MatrixXd>& factors, std::complex<double> multiplier);

}  // namespace orbid::periodic
