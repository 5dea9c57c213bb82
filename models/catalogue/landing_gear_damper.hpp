#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <string_view>
#include <tuple>

#include "models/definition/model.hpp"

namespace orbid::models {

/// Mass on an oleo-pneumatic strut whose foot is moved up and down by the ground z(t).
///
///     m s'' = m (g + z'') - F_gas - F_oil - friction sgn(s')
///     F_gas = p0 area [V0 / (V0 - area s)]^kappa
///     F_oil = c_compression s'|s'| for s' > 0, c_rebound s'|s'| for s' < 0
///
/// State, shape (2): stroke s [m], 0 = gas column at its full length, positive when compressed; stroke_rate [m/s]. The
/// model has no stops: for s < 0 the gas column pulls. At s = V0 / area, where the gas has no room left, the state is
/// no longer finite. Source: forces of gas and oil as in B. Milwitzky, F. E. Cook, "Analysis of landing-gear behavior",
/// NACA Report 1154 (1953): polytropic gas; flow through an orifice, c = rho A^3 / (2 (C_d A_o)^2). rho is the density
/// of the oil, A the area of the piston, C_d and A_o the discharge coefficient and area of the orifice. A valve makes
/// it smaller in rebound. Here with Coulomb friction of the seals, a foot that follows the ground, and no wing lift.
/// Defaults: a strut of a light aircraft in round numbers; static stroke 0.142 m of 0.2 m, natural frequency 2.2 Hz.
struct Strut {
    static constexpr std::string_view name = "landing_gear_damper";
    static constexpr std::string_view summary = "mass on an oleo-pneumatic strut over moving ground";
    static constexpr std::string_view equations =
        "m s'' = m (g + z'') - F_gas - F_oil - friction sgn(s')\n"
        "F_gas = p0 area [V0 / (V0 - area s)]^kappa\n"
        "F_oil = c_compression s'|s'| for s' > 0, c_rebound s'|s'| for s' < 0\n"
        "s = stroke, positive in compression; z = height of the ground\n"
        "variants: harmonic_base: z = amplitude cos(omega t), at its highest at t = 0; measured_base: z'' is the "
        "input\n"
        "base_acceleration [m/s^2], and amplitude and omega are no parameters";

    static constexpr std::array coordinates{real("stroke", "m"), real("stroke_rate", "m/s")};

    static constexpr std::array of_strut{
        Parameter{"m", "kg", positive, 1000.0, "mass on the strut"},
        Parameter{"g", "m/s^2", nonnegative, 9.81, "gravity"},
        Parameter{"p0", "Pa", positive, 5e5, "pressure of the gas at full length"},
        Parameter{"V0", "m^3", positive, 1e-3, "volume of the gas at full length"},
        Parameter{"area", "m^2", positive, 5e-3, "cross section of the gas column"},
        // Between 1 (isothermal) and 1.4 (adiabatic); oil spray keeps it low.
        Parameter{"kappa", "1", positive, 1.1, "polytropic exponent"},
        Parameter{"c_compression", "N s^2/m^2", nonnegative, 2e4, "oil damping in compression"},
        Parameter{"c_rebound", "N s^2/m^2", nonnegative, 6e4, "oil damping in rebound"},
        Parameter{"friction", "N", nonnegative, 300.0, "dry friction of the seals"}};

    template <std::size_t q>
    static bool smooth(const Values<double, q>& p) {
        return p[8] == 0.0;
    }

protected:
    /// g, p0 area / m, area / V0, kappa; mean and half difference of the oil's coefficients over m; friction / m: all
    /// that does not depend on the ground. Parameters in the order above.
    template <class T, std::size_t q>
    static Values<T, 7> strut_constants(const Values<T, q>& p) {
        const T &m = p[0], &g = p[1], &p0 = p[2], &V0 = p[3], &cross_section = p[4], &kappa = p[5];
        const T &in = p[6], &out = p[7], &seals = p[8];
        return {g,        p0 * cross_section / m, cross_section / V0, kappa, 0.5 * (in + out) / m, 0.5 * (in - out) / m,
                seals / m};
    }

    /// @param weight  per mass in the frame of the ground, g + z''
    template <class T, std::size_t k>
    static State<T, 2> motion(const T& weight, const State<T, 2>& x, const Values<T, k>& c, const auto& side) {
        using std::pow;
        const T& v = x[1];
        const T gas = c[1] * pow(1.0 - c[2] * x[0], -c[3]);
        // side (mean + side difference) = side mean + difference: one coefficient on each side.
        const T oil = (side * c[4] + c[5]) * v * v;
        return {v, weight - gas - oil - side * c[6]};
    }
};

/// Over ground of height z = amplitude cos(omega t), at its highest at phase 0.
struct StrutOnHarmonicBase : Strut {
    static constexpr std::string_view variant = "harmonic_base";
    static constexpr auto parameters =
        joined(of_strut, std::array{Parameter{"amplitude", "m", nonnegative, 0.03, "amplitude of the ground"},
                                    Parameter{"omega", "rad/s", positive, 12.0, "frequency of the ground"}});
    static constexpr std::size_t forcing_frequency = 10;

    /// Those of the strut, then amplitude omega^2.
    template <class T>
    static Values<T, 8> reduced(const Values<T, 11>& p) {
        const auto c = strut_constants(p);
        return {c[0], c[1], c[2], c[3], c[4], c[5], c[6], p[9] * p[10] * p[10]};
    }

    /// All that depends on the phase: the weight per mass in the frame of the ground.
    template <class T>
    static T forcing(const T& phase, const Values<T, 8>& c) {
        using std::cos;
        return c[0] - c[7] * cos(phase);
    }
    template <class T>
    static State<T, 2> rhs_forced(const T& weight, const State<T, 2>& x, const Values<T, 8>& c, const auto& side) {
        return motion(weight, x, c, side);
    }
    template <class T>
    static State<T, 2> rhs(const T& phase, const State<T, 2>& x, const Values<T, 8>& c, const auto& side) {
        return motion(forcing<T>(phase, c), x, c, side);
    }
};

/// Over ground whose acceleration was recorded.
struct StrutOnMeasuredBase : Strut {
    static constexpr std::string_view variant = "measured_base";
    static constexpr std::array parameters = of_strut;
    static constexpr std::array inputs{real("base_acceleration", "m/s^2")};  ///< z'', upwards

    template <class T>
    static Values<T, 7> reduced(const Values<T, 9>& p) {
        return strut_constants(p);
    }
    template <class T>
    static State<T, 2> rhs(const T& /*t*/, const State<T, 2>& x, const Values<T, 7>& c, const auto& side,
                           const std::array<T, 1>& u) {
        return motion(c[0] + u[0], x, c, side);
    }
};

/// The model as the registry lists it: its variants, the default first.
struct LandingGearDamper {
    using variants = std::tuple<StrutOnHarmonicBase, StrutOnMeasuredBase>;
};

}  // namespace orbid::models
