#pragma once

#include <array>
#include <string_view>

#include "models/definition/model.hpp"

namespace orbid::models {

/// Spiral that is folded once per turn.
///
///     x' = -y - z,   y' = x + a y,   z' = b + z (x - c)
///
/// State, shape (3): x, y, z, without units.
/// Source: O. E. Roessler, "An equation for continuous chaos", Physics Letters A 57:397-398 (1976); the defaults are
/// the values of that paper.
struct Rossler {
    static constexpr std::string_view name = "rossler";
    static constexpr std::string_view summary = "spiral that is folded once per turn";
    static constexpr std::string_view equations = "x' = -y - z\ny' = x + a y\nz' = b + z (x - c)";

    static constexpr std::array coordinates{real("x", "1"), real("y", "1"), real("z", "1")};
    static constexpr std::array parameters{Parameter{"a", "1/s", any_real, 0.2, "growth of the spiral"},
                                           Parameter{"b", "1/s", any_real, 0.2, "inflow of z"},
                                           Parameter{"c", "1/s", any_real, 5.7, "x beyond which z grows"}};

    template <class T>
    static State<T, 3> rhs(const T& /*t*/, const State<T, 3>& x, const Values<T, 3>& p) {
        return {-x[1] - x[2], x[0] + p[0] * x[1], p[1] + x[2] * (x[0] - p[2])};
    }
};

}  // namespace orbid::models
