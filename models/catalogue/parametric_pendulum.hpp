#pragma once

#include <array>
#include <cmath>
#include <string_view>
#include <tuple>

#include "models/definition/model.hpp"

namespace orbid::models {

/// How the support of the pendulum moves.
enum class Support {
    crank,             ///< crank and connecting rod, (M2)
    crank_as_printed,  ///< (P3) as printed: sin in the denominator where the derivation gives sin^2; not even in t
    harmonic           ///< pure cosine, (P1)
};

/// Pendulum whose support is moved up and down by a crank.
///
///     phi'' + [k1 sgn(phi') + k2 phi' + k3 phi'|phi'|] / (m l^2) + P(t) sin(phi) = 0                          (M1)
///     P(t) = g/l - (A w^2 / l) [cos wt + e (cos 2wt + e^2 sin^4 wt) / (1 - e^2 sin^2 wt)^(3/2)]               (M2)
///
/// State, shape (2): phi [rad], 0 = hanging, on the circle; phi_dot [rad/s]. The support is at its highest at phase 0.
/// Source: van de Wouw, Verbeek, van Campen (1995), (P1) to (P3). (M2) is the second derivative of the crank height A
/// cos wt + L sqrt(1 - e^2 sin^2 wt), e = A/L; the misprint in (P3) is the variant `crank_as_printed`. e >= 1 is no
/// mechanism (the rod is not longer than the crank): the state is then not finite.
template <Support support>
struct PendulumOn {
    static constexpr std::string_view name = "parametric_pendulum";
    static constexpr std::string_view variant = support == Support::crank              ? "crank"
                                                : support == Support::crank_as_printed ? "crank_as_printed"
                                                                                       : "harmonic";
    static constexpr std::string_view summary = "pendulum with friction, its support moved up and down by a crank";
    static constexpr std::string_view equations =
        "phi'' + [k1 sgn(phi') + k2 phi' + k3 phi'|phi'|] / (m l^2) + P(t) sin(phi) = 0\n"
        "P(t) = g/l - (A w^2/l) [cos wt + e (cos 2wt + e^2 sin^4 wt) / (1 - e^2 sin^2 wt)^(3/2)],"
        "  w = omega, e = epsilon\n"
        "variants: crank (above); crank_as_printed: 1 - e^2 sin wt in the denominator; harmonic: P(t) = g/l - (A w^2/l)"
        " cos wt\n"
        "phi = 0 hanging; the support is at its highest at t = 0";

    static constexpr std::array coordinates{angle("phi", "rad"), real("phi_dot", "rad/s")};
    static constexpr std::array parameters{
        Parameter{"m", "kg", positive, 0.0858, "mass"}, Parameter{"l", "m", positive, 0.317, "length"},
        // 1e-3 N m is the friction of a poor bearing; the paper's pendulum has no detectable friction.
        Parameter{"k1", "N m", nonnegative, 0.0, "dry friction", typical(1e-3)},
        Parameter{"k2", "N m s", nonnegative, 4.85e-4, "linear damping"},
        Parameter{"k3", "N m s^2", nonnegative, 1.90e-4, "quadratic damping"},
        Parameter{"g", "m/s^2", positive, 9.81, "gravity"}, Parameter{"A", "m", nonnegative, 0.131, "crank radius"},
        Parameter{"omega", "rad/s", positive, 9.09, "angular frequency of the crank"},
        Parameter{"epsilon", "1", nonnegative, 0.173, "crank radius / rod length"}};
    static constexpr std::size_t forcing_frequency = 7;
    static constexpr std::array<double, 2> symmetry_signs{-1.0, -1.0};
    static constexpr double symmetry_phase_shift = 0.0;

    static bool smooth(const Values<double, 9>& p) { return p[2] == 0.0; }

    /// k1/(m l^2), k2/(m l^2), k3/(m l^2), g/l, A w^2/l, e: all that (M1), (M2) depend on.
    template <class T>
    static Values<T, 6> reduced(const Values<T, 9>& p) {
        const auto& [m, l, k1, k2, k3, g, A, w, e] = p;
        const T inertia = m * l * l;
        return {k1 / inertia, k2 / inertia, k3 / inertia, g / l, A * w * w / l, mechanism(e)};
    }

    /// The same e, or nan for a rod that cannot follow the crank. It is tested first, as stepping towards the phase
    /// where the root vanishes takes a million steps.
    template <class T>
    static T mechanism(const T& e) {
        using std::sqrt;
        if constexpr (support == Support::harmonic)
            return e;
        else
            return e + 0.0 * sqrt(1.0 - e);
    }

    /// P(t) of (M2) at a phase, 1/s^2.
    template <class T>
    static T stiffness(const T& phase, const Values<T, 6>& c) {
        using std::cos, std::sin, std::sqrt;
        const T cosine = cos(phase);
        if constexpr (support == Support::harmonic) {
            return c[3] - c[4] * cosine;
        } else {
            const T& e = c[5];
            const T sine = sin(phase);
            const T square = sine * sine;
            const T e_square = e * e;
            const T root = 1.0 - e_square * (support == Support::crank ? square : sine);
            const T rod = e * (1.0 - 2.0 * square + e_square * square * square) / (root * sqrt(root));
            return c[3] - c[4] * (cosine + rod);
        }
    }

    /// All that depends on the phase.
    template <class T>
    static T forcing(const T& phase, const Values<T, 6>& c) {
        return stiffness(phase, c);
    }

    template <class T>
    static State<T, 2> rhs_forced(const T& stiffness, const State<T, 2>& x, const Values<T, 6>& c, const auto& side) {
        using std::sin;
        const T& v = x[1];
        const T friction = side * c[0] + v * (c[1] + (side * c[2]) * v);
        return {v, -friction - stiffness * sin(x[0])};
    }

    template <class T>
    static State<T, 2> rhs(const T& phase, const State<T, 2>& x, const Values<T, 6>& c, const auto& side) {
        return rhs_forced<T>(stiffness(phase, c), x, c, side);
    }
};

/// The model as the registry lists it: its variants, the default first.
struct ParametricPendulum {
    using variants =
        std::tuple<PendulumOn<Support::crank>, PendulumOn<Support::crank_as_printed>, PendulumOn<Support::harmonic>>;
};

}  // namespace orbid::models
