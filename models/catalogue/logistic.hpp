#pragma once

#include <array>
#include <string_view>

#include "models/definition/model.hpp"

namespace orbid::models {

/// Population whose growth is limited, from one generation to the next.
///
///     x -> r x (1 - x)
///
/// State, shape (1): x, share of the largest possible population. For 0 <= r <= 4 it stays in [0, 1]; with r = 4,
/// x = sin^2(pi u) turns the map into u -> 2 u.
/// Source: R. M. May, "Simple mathematical models with very complicated dynamics", Nature 261:459-467 (1976).
struct Logistic {
    static constexpr std::string_view name = "logistic";
    static constexpr std::string_view summary = "population whose growth is limited, generation by generation";
    static constexpr std::string_view equations = "x -> r x (1 - x)";

    static constexpr std::array coordinates{real("x", "1")};
    static constexpr std::array parameters{Parameter{"r", "1", any_real, 4.0, "growth of a small population"}};

    template <class T>
    static State<T, 1> map(const State<T, 1>& x, const Values<T, 1>& p) {
        return {p[0] * x[0] * (1.0 - x[0])};
    }
};

}  // namespace orbid::models
