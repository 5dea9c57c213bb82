#pragma once

#include <cstddef>

namespace orbid::orbits {

/// Takes the shares of `count` orthonormal columns out of another one, one after the other (modified Gram-Schmidt), and
/// adds them to `shares`.
///
/// @param basis   columns of k numbers, one after the other.
/// @param column  k numbers.
/// @param shares  `count` numbers.
void take_out(const double* basis, std::size_t count, std::size_t k, double* column, double* shares);

/// Sum of a_i b_i, i < k; the order of summation is fixed.
[[nodiscard]] double inner_product(const double* a, const double* b, std::size_t k);

}  // namespace orbid::orbits
