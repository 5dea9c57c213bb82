#pragma once

#include <array>
#include <string_view>

#include "models/definition/model.hpp"

namespace orbid::models {

/// Self-excited oscillator: it gains energy while |x| < 1 and loses it beyond.
///
///     x'' - mu (1 - x^2) x' + x = 0
///
/// State, shape (2): x, x_dot, without units. Symmetric under (x, x_dot) -> -(x, x_dot). For mu > 0 every motion but
/// rest goes to one limit cycle. Its period is 2 pi for small and (3 - 2 ln 2) mu for large mu, where it is stiff.
/// Source: B. van der Pol, "On relaxation-oscillations", Philosophical Magazine (7) 2:978-992 (1926).
struct VanDerPol {
    static constexpr std::string_view name = "van_der_pol";
    static constexpr std::string_view summary = "self-excited oscillator";
    static constexpr std::string_view equations = "x'' - mu (1 - x^2) x' + x = 0";

    static constexpr std::array coordinates{real("x", "1"), real("x_dot", "1/s")};
    static constexpr std::array parameters{Parameter{"mu", "1/s", any_real, 1.0, "strength of the excitation"}};
    static constexpr std::array<double, 2> symmetry_signs{-1.0, -1.0};
    static constexpr double symmetry_phase_shift = 0.0;

    template <class T>
    static State<T, 2> rhs(const T& /*t*/, const State<T, 2>& x, const Values<T, 1>& p) {
        return {x[1], p[0] * (1.0 - x[0] * x[0]) * x[1] - x[0]};
    }
};

}  // namespace orbid::models
