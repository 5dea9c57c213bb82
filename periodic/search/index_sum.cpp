#include "periodic/search/index_sum.hpp"

#include <complex>

namespace orbid::periodic {

std::vector<int> index_sums(std::span<const PeriodicOrbit> orbits, int longest) {
    std::vector<int> sums;
    for (int n = 1; n <= longest; ++n) {
        int sum = 0;
        for (const PeriodicOrbit& orbit : orbits) {
            if (orbit.period < 1 || n % orbit.period != 0) continue;
            std::complex<double> determinant = 1.0;
            for (const std::complex<double>& multiplier : orbit.multipliers)
                determinant *= 1.0 - std::pow(multiplier, n / orbit.period);
            sum += orbit.period * (determinant.real() > 0.0 ? 1 : determinant.real() < 0.0 ? -1 : 0);
        }
        sums.push_back(sum);
    }
    return sums;
}

}  // namespace orbid::periodic
