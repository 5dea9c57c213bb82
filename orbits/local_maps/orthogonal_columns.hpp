#pragma once

#include <cstddef>

namespace orbid::orbits {

/// Removes the shares of `count` orthonormal columns from another column, one by one (modified Gram-Schmidt), and adds
/// them to `shares`.
///
/// @param basis   columns of k numbers, stored in order.
/// @param column  k numbers.
/// @param shares  `count` numbers.
void take_out(const double* basis, std::size_t count, std::size_t k, double* column, double* shares);

/// Sum of a_i b_i, i < k; the order of summation is fixed.
[[nodiscard]] double inner_product(const double* a, const double* b, std::size_t k);

}  // namespace orbid::orbits
