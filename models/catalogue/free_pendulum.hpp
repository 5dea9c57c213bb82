#pragma once

#include <array>
#include <cmath>
#include <string_view>
#include <tuple>

#include "models/definition/model.hpp"

namespace orbid::models {

/// Freely swinging pendulum with friction, read by an encoder with an offset: base of the variants.
///
/// State, shape (2): phi [rad], 0 = hanging, on the circle; phi_dot [rad/s].
/// Source: torque balance about the pivot, divided by the moment of inertia.
struct PendulumOnBearing {
    static constexpr std::string_view name = "free_pendulum";
    static constexpr std::string_view summary = "freely swinging pendulum with dry, linear and quadratic friction";
    static constexpr std::string_view equations =
        "phi'' = -w0sq sin(phi) - c1 sgn(phi') - c2 phi' - c3 phi'|phi'|\n"
        "the instrument reads phi + offset; phi = 0 hanging\n"
        "variants: quadratic (above); extended: besides, with v = phi',\n"
        "  - c5 v^3 - cp v (v^2 + 0.05^2)^((p - 1)/2)\n"
        "  - [c_load |cos(phi) + v^2/w0sq| + c_angle (1 - cos(phi)) + c_slow exp(-(v/v_slow)^2)] sgn(v)\n"
        "  and an eccentric encoder: phi + offset + e_cos (cos(phi) - 1) + e_sin sin(phi)";

    static constexpr std::array coordinates{angle("phi", "rad"), real("phi_dot", "rad/s")};
    // Defaults and sizes: a rod of a few decimetres on ball bearings, which swings for a minute or so.
    static constexpr std::array shared{
        Parameter{"w0sq", "1/s^2", positive, 30.0, "square of the small-angle frequency"},
        Parameter{"c1", "rad/s^2", nonnegative, 0.0, "dry friction", typical(0.05)},
        Parameter{"c2", "1/s", nonnegative, 0.05, "linear damping"},
        Parameter{"c3", "1/rad", nonnegative, 0.0, "quadratic damping", typical(0.01)},
        Parameter{"offset", "rad", any_real, 0.0, "reading of the encoder when hanging at rest", typical(0.01)}};
    static constexpr std::array<double, 2> symmetry_signs{-1.0, -1.0};
    static constexpr double symmetry_phase_shift = 0.0;
};

/// The variant `quadratic`.
///
///     phi'' = -w0sq sin(phi) - c1 sgn(phi') - c2 phi' - c3 phi'|phi'|,   reading of phi = phi + offset
struct PendulumWithQuadraticFriction : PendulumOnBearing {
    static constexpr std::string_view variant = "quadratic";
    static constexpr std::array parameters = shared;

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

/// The variant `extended`: several laws of friction, to be compared by how well they predict; each is 0 unless given.
///
///     phi'' = -w0sq sin(phi) - s [c1 + c_load |cos phi + v^2/w0sq| + c_angle (1 - cos phi) + c_slow e^(-(v/v_slow)^2)]
///             - c2 v - c3 v|v| - c5 v^3 - cp v (v^2 + v0^2)^((p - 1)/2),      v = phi', s = sgn v, v0 = 0.05 rad/s
///     reading: phi + offset + e_cos (cos phi - 1) + e_sin sin phi; its rate
///
/// c_load: dry friction in proportion to the force along the rod, in units of the weight (all mass in one point).
/// c_angle: dry friction that grows with the angle. c_slow: Stribeck's rise of the dry friction at low speed. cp: a
/// power of the speed. Below v0, where the other terms dominate, it turns linear, so that no power of a number near 0
/// is taken. e_cos, e_sin: an eccentric code wheel; counted from hanging.
struct PendulumWithExtendedFriction : PendulumOnBearing {
    static constexpr std::string_view variant = "extended";
    static constexpr auto parameters = joined(
        shared,
        std::array{
            Parameter{"c5", "s/rad^2", nonnegative, 0.0, "cubic damping", typical(1e-3)},
            Parameter{"cp", "rad^(1-p) s^(p-2)", nonnegative, 0.0, "damping by the power p", typical(0.01)},
            Parameter{"p", "1", positive, 2.0, "power of the speed"},
            Parameter{"c_load", "rad/s^2", nonnegative, 0.0, "dry friction per weight on the bearing", typical(0.05)},
            Parameter{"c_angle", "rad/s^2", nonnegative, 0.0, "growth of the dry friction with the angle",
                      typical(0.05)},
            Parameter{"c_slow", "rad/s^2", nonnegative, 0.0, "rise of the dry friction at low speed", typical(0.05)},
            Parameter{"v_slow", "rad/s", positive, 0.3, "speed at which the rise has fallen to 1/e"},
            Parameter{"e_cos", "rad", any_real, 0.0, "eccentricity of the encoder, cosine", typical(0.005)},
            Parameter{"e_sin", "rad", any_real, 0.0, "eccentricity of the encoder, sine", typical(0.005)}});

    static bool smooth(const Values<double, 14>& p) {
        return p[1] == 0.0 && p[8] == 0.0 && p[9] == 0.0 && p[10] == 0.0;
    }

    template <class T>
    static State<T, 2> rhs(const T& /*t*/, const State<T, 2>& x, const Values<T, 14>& p, const auto& side) {
        using std::abs, std::cos, std::exp, std::pow, std::sin;
        constexpr double v0 = 0.05;
        const T& v = x[1];
        const T square = v * v, cosine = cos(x[0]);
        const T slowness = square / (p[11] * p[11]);
        const T dry = p[1] + p[8] * abs(cosine + square / p[0]) + p[9] * (1.0 - cosine) + p[10] * exp(-slowness);
        const T wet = p[2] + (side * p[3]) * v + p[5] * square + p[6] * pow(square + v0 * v0, 0.5 * (p[7] - 1.0));
        return {v, -p[0] * sin(x[0]) - (side * dry + v * wet)};
    }

    template <class T>
    static State<T, 2> instrument(const State<T, 2>& x, const Values<T, 14>& p) {
        using std::cos, std::sin;
        const T cosine = cos(x[0]), sine = sin(x[0]);
        return {x[0] + p[4] + p[12] * (cosine - 1.0) + p[13] * sine, x[1] * (1.0 + p[13] * cosine - p[12] * sine)};
    }
};

/// The model as the registry lists it: its variants, the default first.
struct FreePendulum {
    using variants = std::tuple<PendulumWithQuadraticFriction, PendulumWithExtendedFriction>;
};

}  // namespace orbid::models
