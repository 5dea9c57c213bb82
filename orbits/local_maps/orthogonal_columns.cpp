#include "orbits/local_maps/orthogonal_columns.hpp"

namespace orbid::orbits {

double inner_product(const double* a, const double* b, std::size_t k) {
    // Eight sums side by side: what the processor's registers take at once, spelled out because a compiler must not
    // change the order of a sum.
    constexpr std::size_t lanes = 8;
    double sums[lanes] = {};
    std::size_t i = 0;
    for (; i + lanes <= k; i += lanes)
        for (std::size_t lane = 0; lane < lanes; ++lane)
            sums[lane] += a[i + lane] * b[i + lane];
    double rest = 0.0;
    for (; i < k; ++i)
        rest += a[i] * b[i];
    return ((sums[0] + sums[4]) + (sums[1] + sums[5])) + ((sums[2] + sums[6]) + (sums[3] + sums[7])) + rest;
}

void take_out(const double* basis, std::size_t count, std::size_t k, double* column, double* shares) {
    for (std::size_t c = 0; c < count; ++c) {
        const double* unit = basis + c * k;
        const double share = inner_product(unit, column, k);
        shares[c] += share;
        for (std::size_t i = 0; i < k; ++i)
            column[i] -= share * unit[i];
    }
}

}  // namespace orbid::orbits
