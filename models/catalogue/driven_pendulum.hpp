#pragma once

#include <array>
#include <cmath>
#include <numbers>
#include <string_view>

#include "models/definition/model.hpp"

namespace orbid::models {

/// Damped pendulum driven by a harmonic torque, in units of its small-angle frequency.
///
///     theta'' = -gamma theta' - sin(theta) + A cos(omega t)
///
/// State, shape (2): theta [rad], 0 = hanging, on the circle; theta_dot [rad/s]. Symmetric under (theta, theta_dot) ->
/// -(theta, theta_dot) with half a forcing period.
/// Source: torque balance about the pivot, divided by its stiffness m g l, time in units of 1 / sqrt(m g l / J).
/// Defaults: the chaotic case whose cycles are tabulated in tests/reference/driven_pendulum_orbits.json.
struct DrivenPendulum {
    static constexpr std::string_view name = "driven_pendulum";
    static constexpr std::string_view summary = "damped pendulum driven by a harmonic torque";
    static constexpr std::string_view equations =
        "theta'' = -gamma theta' - sin(theta) + A cos(omega t)\n"
        "theta = 0 hanging; the time is in units of the reciprocal small-angle frequency";

    static constexpr std::array coordinates{angle("theta", "rad"), real("theta_dot", "rad/s")};
    static constexpr std::array parameters{Parameter{"gamma", "1/s", nonnegative, 0.2, "damping"},
                                           Parameter{"A", "1/s^2", any_real, 1.2, "amplitude of the torque"},
                                           Parameter{"omega", "rad/s", positive, 2.0 / 3.0, "frequency of the torque"}};
    static constexpr std::size_t forcing_frequency = 2;
    static constexpr std::array<double, 2> symmetry_signs{-1.0, -1.0};
    static constexpr double symmetry_phase_shift = std::numbers::pi;

    /// All that depends on the phase: the torque.
    template <class T>
    static T forcing(const T& phase, const Values<T, 3>& p) {
        using std::cos;
        return p[1] * cos(phase);
    }

    template <class T>
    static State<T, 2> rhs_forced(const T& torque, const State<T, 2>& x, const Values<T, 3>& p, const auto& /*side*/) {
        using std::sin;
        return {x[1], torque - p[0] * x[1] - sin(x[0])};
    }

    template <class T>
    static State<T, 2> rhs(const T& phase, const State<T, 2>& x, const Values<T, 3>& p) {
        return rhs_forced<T>(forcing<T>(phase, p), x, p, 0.0);
    }
};

}  // namespace orbid::models
