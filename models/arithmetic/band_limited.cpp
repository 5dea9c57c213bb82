#include "models/arithmetic/band_limited.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>

namespace orbid::models {

namespace {

constexpr std::size_t half_width = 32;  // of the window, in samples

using Taps = std::array<std::array<double, 3>, half_width>;

/// First three derivatives of w(s / half_width) sinc(s) at the whole numbers from 1.
Taps derivative_taps() {
    constexpr double beta = 16.0;
    constexpr double pi2 = std::numbers::pi * std::numbers::pi;
    constexpr double width = half_width;
    Taps taps{};
    for (std::size_t k = 1; k < half_width; ++k) {
        const auto n = static_cast<double>(k);
        const double x = n / width;
        const double root = std::sqrt(1.0 - x * x);
        const double w = std::exp(beta * (root - 1.0));
        const double root1 = -x / root / width;  // derivatives of the root by s
        const double root2 = -1.0 / (root * root * root * width * width);
        const double w1 = beta * root1 * w;
        const double w2 = (beta * root2 + beta * beta * root1 * root1) * w;
        const double sign = k % 2 == 0 ? 1.0 : -1.0;
        const double f1 = sign / n;  // of sinc, which is 0 here
        const double f2 = -2.0 * f1 / n;
        const double f3 = sign * (6.0 / (n * n * n) - pi2 / n);
        taps[k] = {w * f1, 2.0 * w1 * f1 + w * f2, 3.0 * w2 * f1 + 3.0 * w1 * f2 + w * f3};
    }
    return taps;
}

}  // namespace

std::vector<std::array<double, 3>> band_limited_derivatives(std::span<const double> samples) {
    const std::size_t count = samples.size();
    // The samples, and as many on each side by reflection in the end points.
    std::vector<double> u(count + 2 * half_width);
    std::copy(samples.begin(), samples.end(), u.begin() + half_width);
    for (std::size_t k = 1; k <= half_width; ++k) {
        u[half_width - k] = 2.0 * u[half_width] - u[half_width + k];
        u[half_width + count - 1 + k] = 2.0 * u[half_width + count - 1] - u[half_width + count - 1 - k];
    }
    const Taps taps = derivative_taps();
    std::vector<std::array<double, 3>> result(count);
    for (std::size_t j = 0; j < count; ++j) {
        const double* here = u.data() + half_width + j;
        std::array<double, 3> sum{};
        for (std::size_t n = 1; n < half_width; ++n) {
            // u(s) = sum_k u_k f(s - k): what lies before has positive arguments. Differences from u(j): the
            // derivatives of a constant are 0 to the last digit.
            const double before = *(here - n) - *here, after = *(here + n) - *here;
            sum[0] += taps[n][0] * (before - after);
            sum[1] += taps[n][1] * (before + after);
            sum[2] += taps[n][2] * (before - after);
        }
        result[j] = sum;
    }
    return result;
}

std::array<double, 8> hermite_septic(double first, const std::array<double, 3>& first_derivatives, double last,
                                     const std::array<double, 3>& last_derivatives) {
    const double c0 = first, c1 = first_derivatives[0], c2 = first_derivatives[1] / 2.0,
                 c3 = first_derivatives[2] / 6.0;
    // What the cubic through the first end misses at the last one.
    const double d0 = last - (c0 + c1 + c2 + c3);
    const double d1 = last_derivatives[0] - (c1 + 2.0 * c2 + 3.0 * c3);
    const double d2 = last_derivatives[1] / 2.0 - (c2 + 3.0 * c3);
    const double d3 = last_derivatives[2] / 6.0 - c3;
    return {c0,
            c1,
            c2,
            c3,
            35.0 * d0 - 15.0 * d1 + 5.0 * d2 - d3,
            -84.0 * d0 + 39.0 * d1 - 14.0 * d2 + 3.0 * d3,
            70.0 * d0 - 34.0 * d1 + 13.0 * d2 - 3.0 * d3,
            -20.0 * d0 + 10.0 * d1 - 4.0 * d2 + d3};
}

}  // namespace orbid::models
