#pragma once

#include <array>
#include <cmath>
#include <string_view>

#include "models/model.hpp"

namespace orbid::models {

/// Mass on an oleo-pneumatic strut whose foot is moved up and down.
///
///     m s'' = m g - m amplitude omega^2 cos(omega t) - F_gas - F_oil - friction sgn(s')
///     F_gas = p0 area [V0 / (V0 - area s)]^kappa
///     F_oil = c_compression s'|s'| for s' > 0, c_rebound s'|s'| for s' < 0
///
/// State, shape (2): stroke s [m], 0 = gas column at its full length, positive when compressed; stroke_rate [m/s]. The
/// height of the foot is amplitude cos(omega t), so it is at its highest at phase 0. Stops are no part of the model:
/// s < 0 is a gas column that pulls, and at s = V0 / area, where the gas has no room left, the state stops being
/// finite. Source: forces of gas and oil as in B. Milwitzky, F. E. Cook, "Analysis of landing-gear behavior", NACA
/// Report 1154 (1953): polytropic gas; flow through an orifice, c = rho A^3 / (2 (C_d A_o)^2) with the density of the
/// oil, the area of the piston and the discharge coefficient and area of the orifice, which a valve makes smaller in
/// rebound. Here with Coulomb friction of the seals, a foot that follows the ground, and no wing lift. Defaults: a
/// strut of a light aircraft in round numbers; static stroke 0.142 m of 0.2 m, natural frequency 2.2 Hz.
struct LandingGearDamper {
    static constexpr std::string_view name = "landing_gear_damper";
    static constexpr std::string_view summary = "mass on an oleo-pneumatic strut over moving ground";
    static constexpr std::string_view equations =
        "m s'' = m g - m amplitude omega^2 cos(omega t) - F_gas - F_oil - friction sgn(s')\n"
        "F_gas = p0 area [V0 / (V0 - area s)]^kappa\n"
        "F_oil = c_compression s'|s'| for s' > 0, c_rebound s'|s'| for s' < 0\n"
        "s = stroke, positive in compression; the ground is at its highest at t = 0";

    static constexpr std::array coordinates{real("stroke", "m"), real("stroke_rate", "m/s")};
    static constexpr std::array parameters{
        Parameter{"m", "kg", positive, 1000.0, "mass on the strut"},
        Parameter{"g", "m/s^2", nonnegative, 9.81, "gravity"},
        Parameter{"p0", "Pa", positive, 5e5, "pressure of the gas at full length"},
        Parameter{"V0", "m^3", positive, 1e-3, "volume of the gas at full length"},
        Parameter{"area", "m^2", positive, 5e-3, "cross section of the gas column"},
        // Between 1 (isothermal) and 1.4 (adiabatic); oil spray keeps it low.
        Parameter{"kappa", "1", positive, 1.1, "polytropic exponent"},
        Parameter{"c_compression", "N s^2/m^2", nonnegative, 2e4, "oil damping in compression"},
        Parameter{"c_rebound", "N s^2/m^2", nonnegative, 6e4, "oil damping in rebound"},
        Parameter{"friction", "N", nonnegative, 300.0, "dry friction of the seals"},
        Parameter{"amplitude", "m", nonnegative, 0.03, "amplitude of the ground"},
        Parameter{"omega", "rad/s", positive, 12.0, "frequency of the ground"}};
    static constexpr std::size_t forcing_frequency = 10;

    static bool smooth(const Values<double, 11>& p) { return p[8] == 0.0; }

    /// g, amplitude omega^2, p0 area / m, area / V0, kappa; mean and half difference of the oil's coefficients over m;
    /// friction / m.
    template <class T>
    static Values<T, 8> reduced(const Values<T, 11>& p) {
        const auto& [m, g, p0, V0, area, kappa, compression, rebound, friction, amplitude, omega] = p;
        return {g,
                amplitude * omega * omega,
                p0 * area / m,
                area / V0,
                kappa,
                0.5 * (compression + rebound) / m,
                0.5 * (compression - rebound) / m,
                friction / m};
    }

    /// All that depends on the phase: the weight per mass in the frame of the ground.
    template <class T>
    static T forcing(const T& phase, const Values<T, 8>& c) {
        using std::cos;
        return c[0] - c[1] * cos(phase);
    }

    template <class T>
    static State<T, 2> rhs_forced(const T& weight, const State<T, 2>& x, const Values<T, 8>& c, const auto& side) {
        using std::pow;
        const T& v = x[1];
        const T gas = c[2] * pow(1.0 - c[3] * x[0], -c[4]);
        // side (mean + side difference) = side mean + difference: one coefficient on each side.
        const T oil = (side * c[5] + c[6]) * v * v;
        return {v, weight - gas - oil - side * c[7]};
    }

    template <class T>
    static State<T, 2> rhs(const T& phase, const State<T, 2>& x, const Values<T, 8>& c, const auto& side) {
        return rhs_forced<T>(forcing<T>(phase, c), x, c, side);
    }
};

}  // namespace orbid::models
