#pragma once

#include <cmath>

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
[[nodiscard]] inline double kaplan_yorke_dimension(const Eigen::VectorXd& exponents) {
    double sum = 0.0;
    for (Eigen::Index j = 0; j < exponents.size(); ++j) {
        const double next = sum + exponents[j];
        if (std::isnan(next)) return next;
        if (next < 0.0) return static_cast<double>(j) + sum / -exponents[j];
        sum = next;
    }
    return static_cast<double>(exponents.size());
}

}  // namespace orbid::orbits
