#pragma once

#include <cmath>
#include <cstdint>
#include <numbers>
#include <random>
#include <vector>

#include "orbits/cycles/cycle.hpp"
#include "tests/periodic/orbit/reference_orbits.hpp"

namespace orbid::tests {

/// Standard normal numbers, the same on every platform (Box and Muller on a generator fixed by the standard).
class NormalNumbers {
public:
    explicit NormalNumbers(std::uint64_t seed) : bits_(seed) {}
    [[nodiscard]] double uniform() { return (static_cast<double>(bits_() >> 11) + 0.5) * 0x1p-53; }
    [[nodiscard]] double operator()() {
        const double radius = std::sqrt(-2.0 * std::log(uniform()));
        return radius * std::cos(2.0 * std::numbers::pi * uniform());
    }

private:
    std::mt19937_64 bits_;
};

/// The reference orbits of the pendulum and their mirror partners as a measurement would give them: independent normal
/// errors of `error` times the range of each coordinate (2 pi rad, 29.3 rad/s), which is the covariance that is told.
inline std::vector<orbits::Cycle> measured_cycles(const ReferenceOrbits& table, double error, std::uint64_t seed) {
    NormalNumbers normal(seed);
    const Eigen::Vector2d sd(error * 2.0 * std::numbers::pi, error * 29.3);
    std::vector<orbits::Cycle> cycles;
    for (const ReferenceOrbit& orbit : table.orbits)
        for (const double sign : {1.0, -1.0}) {
            if (orbit.mirror_symmetric && sign < 0.0) continue;
            orbits::Cycle cycle;
            cycle.period = orbit.period;
            cycle.rotation = {static_cast<int>(sign) * orbit.rotation};
            cycle.points = sign * orbit.points;
            const Eigen::Index records = cycle.points.size();
            cycle.covariance.setZero(records, records);
            for (Eigen::Index k = 0; k < records; ++k) {
                cycle.points(k % 2, k / 2) += sd(k % 2) * normal();
                cycle.covariance(k, k) = sd(k % 2) * sd(k % 2);
            }
            cycles.push_back(std::move(cycle));
        }
    return cycles;
}

}  // namespace orbid::tests
