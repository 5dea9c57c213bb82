#pragma once

#include <array>
#include <cmath>
#include <numbers>
#include <string_view>

#include "models/definition/model.hpp"

namespace orbid::models {

/// Forced oscillator with a cubic spring.
///
///     x'' + delta x' + alpha x + beta x^3 = gamma cos(omega t)
///
/// State, shape (2): x, x_dot, without units. Symmetric under (x, x_dot) -> -(x, x_dot) with half a forcing period.
/// Source: G. Duffing's equation in its common form; the defaults are the chaotic two-well case that text books plot.
struct Duffing {
    static constexpr std::string_view name = "duffing";
    static constexpr std::string_view summary = "forced oscillator with a cubic spring";
    static constexpr std::string_view equations = "x'' + delta x' + alpha x + beta x^3 = gamma cos(omega t)";

    static constexpr std::array coordinates{real("x", "1"), real("x_dot", "1/s")};
    static constexpr std::array parameters{Parameter{"delta", "1/s", nonnegative, 0.3, "damping"},
                                           Parameter{"alpha", "1/s^2", any_real, -1.0, "linear stiffness"},
                                           Parameter{"beta", "1/s^2", any_real, 1.0, "cubic stiffness"},
                                           Parameter{"gamma", "1/s^2", any_real, 0.5, "amplitude of the forcing"},
                                           Parameter{"omega", "rad/s", positive, 1.2, "frequency of the forcing"}};
    static constexpr std::size_t forcing_frequency = 4;
    static constexpr std::array<double, 2> symmetry_signs{-1.0, -1.0};
    static constexpr double symmetry_phase_shift = std::numbers::pi;

    /// All that depends on the phase: the force.
    template <class T>
    static T forcing(const T& phase, const Values<T, 5>& p) {
        using std::cos;
        return p[3] * cos(phase);
    }

    template <class T>
    static State<T, 2> rhs_forced(const T& force, const State<T, 2>& x, const Values<T, 5>& p, const auto& /*side*/) {
        const T& q = x[0];
        return {x[1], force - p[0] * x[1] - q * (p[1] + p[2] * q * q)};
    }

    template <class T>
    static State<T, 2> rhs(const T& phase, const State<T, 2>& x, const Values<T, 5>& p) {
        return rhs_forced<T>(forcing<T>(phase, p), x, p, 0.0);
    }
};

}  // namespace orbid::models
