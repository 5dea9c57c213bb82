#pragma once

#include <array>
#include <string_view>

#include "models/definition/model.hpp"

namespace orbid::models {

/// Three modes of thermal convection.
///
///     x' = sigma (y - x),   y' = x (rho - z) - y,   z' = x y - beta z
///
/// State, shape (3), without units: x overturning, y and z temperature. Symmetric under (x, y, z) -> (-x, -y, z).
/// Source: E. N. Lorenz, "Deterministic nonperiodic flow", Journal of the Atmospheric Sciences 20:130-141 (1963); the
/// defaults are the values of that paper.
struct Lorenz {
    static constexpr std::string_view name = "lorenz";
    static constexpr std::string_view summary = "three modes of thermal convection";
    static constexpr std::string_view equations = "x' = sigma (y - x)\ny' = x (rho - z) - y\nz' = x y - beta z";

    static constexpr std::array coordinates{real("x", "1"), real("y", "1"), real("z", "1")};
    static constexpr std::array parameters{
        Parameter{"sigma", "1/s", positive, 10.0, "Prandtl number"},
        Parameter{"rho", "1/s", nonnegative, 28.0, "Rayleigh number over its critical value"},
        Parameter{"beta", "1/s", positive, 8.0 / 3.0, "geometric factor of the rolls"}};
    static constexpr std::array<double, 3> symmetry_signs{-1.0, -1.0, 1.0};
    static constexpr double symmetry_phase_shift = 0.0;

    template <class T>
    static State<T, 3> rhs(const T& /*t*/, const State<T, 3>& x, const Values<T, 3>& p) {
        return {p[0] * (x[1] - x[0]), x[0] * (p[1] - x[2]) - x[1], x[0] * x[1] - p[2] * x[2]};
    }
};

}  // namespace orbid::models
