#pragma once

#include <array>
#include <cmath>
#include <string_view>

#include "models/definition/model.hpp"

namespace orbid::tests {

/// Mass on a linear spring with dry friction only, pushed by a force: solved in closed form between velocity zeros.
///     x'' = -w2 x - c sgn(x') + b cos(omega t)
struct DryOscillator {
    static constexpr std::string_view name = "dry_oscillator";
    static constexpr std::string_view summary = "spring, dry friction, harmonic force";
    static constexpr std::string_view equations = "x'' = -w2 x - c sgn(x') + b cos(omega t)";
    static constexpr std::array coordinates{models::real("x", "m"), models::real("x_dot", "m/s")};
    static constexpr std::array parameters{
        models::Parameter{"w2", "1/s^2", models::positive, 4.0, "stiffness"},
        models::Parameter{"c", "m/s^2", models::nonnegative, 0.5, "dry friction"},
        models::Parameter{"b", "m/s^2", models::any_real, 0.0, "force", models::typical(1.0)},
        models::Parameter{"omega", "rad/s", models::positive, 1.0, "frequency of the force"}};
    static constexpr std::size_t forcing_frequency = 3;
    static bool smooth(const models::Values<double, 4>& p) { return p[1] == 0.0; }
    template <class T>
    static models::State<T, 2> rhs(const T& phase, const models::State<T, 2>& x, const models::Values<T, 4>& p,
                                   double side) {
        using std::cos;
        return {x[1], p[2] * cos(phase) - p[0] * x[0] - side * p[1]};
    }
};

}  // namespace orbid::tests
