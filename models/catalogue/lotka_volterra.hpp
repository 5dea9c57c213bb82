#pragma once

#include <array>
#include <string_view>

#include "models/definition/model.hpp"

namespace orbid::models {

/// Prey u and predators v.
///
///     u' = alpha u - beta u v,   v' = -gamma v + delta u v
///
/// Conserved: delta u - gamma ln u + beta v - alpha ln v. State, shape (2): u, v in thousands of animals.
/// Source: Lotka (1925), Volterra (1926); the defaults suit the Hudson's Bay hare and lynx series, time in years.
struct LotkaVolterra {
    static constexpr std::string_view name = "lotka_volterra";
    static constexpr std::string_view summary = "prey and predators";
    static constexpr std::string_view equations = "u' = alpha u - beta u v\nv' = -gamma v + delta u v";

    static constexpr std::array coordinates{real("u", "1e3"), real("v", "1e3")};
    static constexpr std::array parameters{Parameter{"alpha", "1/a", positive, 0.55, "growth of prey"},
                                           Parameter{"beta", "1/a", positive, 0.028, "prey lost per predator"},
                                           Parameter{"gamma", "1/a", positive, 0.8, "decline of predators"},
                                           Parameter{"delta", "1/a", positive, 0.024, "predators won per prey"}};

    template <class T>
    static State<T, 2> rhs(const T& /*t*/, const State<T, 2>& x, const Values<T, 4>& p) {
        const auto& [alpha, beta, gamma, delta] = p;
        return {x[0] * (alpha - beta * x[1]), x[1] * (delta * x[0] - gamma)};
    }
};

}  // namespace orbid::models
