#pragma once

#include <Eigen/Core>

namespace orbid::orbits {

/// Dimension that Lyapunov exponents suggest (Kaplan and Yorke 1979), the information dimension of typical attractors:
///
///     D = j + (lambda_1 + ... + lambda_j) / |lambda_{j+1}|,   j the most exponents whose sum is not negative
///
/// 0 when the largest exponent is negative, n when the sum of all is not negative, nan when an exponent that counts
/// is nan. An exponent of -inf counts as j whole dimensions.
///
/// @param exponents  in descending order, shape (n), any unit.
[[nodiscard]] double kaplan_yorke_dimension(const Eigen::VectorXd& exponents);

}  // namespace orbid::orbits
