#pragma once

#include <array>
#include <cmath>
#include <string_view>

#include "models/model.hpp"

namespace orbid::models {

/// Pendulum swinging freely, with dry, linear and quadratic friction, read by an encoder whose zero is off.
///
///     phi'' = -w0sq sin(phi) - c1 sgn(phi') - c2 phi' - c3 phi'|phi'|,   reading of phi = phi + offset
///
/// State, shape (2): phi [rad], 0 = hanging, on the circle; phi_dot [rad/s].
/// Source: torque balance about the pivot, divided by the moment of inertia.
struct FreePendulum {
    static constexpr std::string_view name = "free_pendulum";
    static constexpr std::string_view summary = "freely swinging pendulum with dry, linear and quadratic friction";
    static constexpr std::string_view equations =
        "phi'' = -w0sq sin(phi) - c1 sgn(phi') - c2 phi' - c3 phi'|phi'|\n"
        "the instrument reads phi + offset; phi = 0 hanging";

    static constexpr std::array coordinates{angle("phi", "rad"), real("phi_dot", "rad/s")};
    // Defaults and sizes: a rod of a few decimetres on ball bearings, which swings for a minute or so.
    static constexpr std::array parameters{
        Parameter{"w0sq", "1/s^2", positive, 30.0, "square of the small-angle frequency"},
        Parameter{"c1", "rad/s^2", nonnegative, 0.0, "dry friction", typical(0.05)},
        Parameter{"c2", "1/s", nonnegative, 0.05, "linear damping"},
        Parameter{"c3", "1/rad", nonnegative, 0.0, "quadratic damping", typical(0.01)},
        Parameter{"offset", "rad", any_real, 0.0, "reading of the encoder when hanging at rest", typical(0.01)}};
    static constexpr std::array<double, 2> symmetry_signs{-1.0, -1.0};
    static constexpr double symmetry_phase_shift = 0.0;

    static bool smooth(const Values<double, 5>& p) { return p[1] == 0.0; }

    template <class T>
    static State<T, 2> rhs(const T& /*t*/, const State<T, 2>& x, const Values<T, 5>& p, const auto& side) {
        using std::sin;
        const T& v = x[1];
        return {v, -p[0] * sin(x[0]) - (side * p[1] + v * (p[2] + (side * p[3]) * v))};
    }

    template <class T>
    static State<T, 2> instrument(const State<T, 2>& x, const Values<T, 5>& p) {
        return {x[0] + p[4], x[1]};
    }
};

}  // namespace orbid::models
