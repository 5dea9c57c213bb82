#pragma once

#include <optional>
#include <string>

#include <Eigen/Core>

namespace orbid::periodic {

/// The cycle of Henon's map x_{n+1} = 1 - a x_n^2 + b x_{n-1} with a code of signs, by Biham and Wenzel's artificial
/// dynamics: the cycle is where
///
///     dx_n/ds = s_n (1 - a x_n^2 + b x_{n-1} - x_{n+1}),   n mod p,
///
/// comes to rest, s_n = +1 for '+', -1 for '-' (mostly the signs of x_n). A word whose cycle does not exist runs away;
/// rare ones circle for ever.
///
/// @param word  of '+' and '-', p >= 1 of them.
/// @return shape (2, p): states (x_n, b x_{n-1}) to 1e-10 or so, a start for solve_multiple_shooting(); none.
/// @throws std::invalid_argument on other symbols or an empty word.
/// Source: O. Biham and W. Wenzel, Phys. Rev. Lett. 63, 819 (1989).
[[nodiscard]] std::optional<Eigen::MatrixXd> henon_start(double a, double b, const std::string& word);

}  // namespace orbid::periodic
