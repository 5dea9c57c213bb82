#pragma once

#include <array>
#include <string_view>

#include "models/definition/model.hpp"

namespace orbid::models {

/// Plane that is stretched and folded once per iteration.
///
///     x -> 1 - a x^2 + y,   y -> b x
///
/// State, shape (2): x, y, without units. The Jacobian's determinant is -b everywhere.
/// Source: M. Henon, "A two-dimensional mapping with a strange attractor", Communications in Mathematical Physics
/// 50:69-77 (1976); the defaults are the values of that paper.
struct Henon {
    static constexpr std::string_view name = "henon";
    static constexpr std::string_view summary = "plane that is stretched and folded once per iteration";
    static constexpr std::string_view equations = "x -> 1 - a x^2 + y\ny -> b x";

    static constexpr std::array coordinates{real("x", "1"), real("y", "1")};
    static constexpr std::array parameters{Parameter{"a", "1", any_real, 1.4, "strength of the fold"},
                                           Parameter{"b", "1", any_real, 0.3, "contraction of areas"}};

    template <class T>
    static State<T, 2> map(const State<T, 2>& x, const Values<T, 2>& p) {
        return {1.0 - p[0] * x[0] * x[0] + x[1], p[1] * x[0]};
    }
};

}  // namespace orbid::models
