#pragma once

#include <array>
#include <string_view>

#include "models/definition/model.hpp"

namespace orbid::models {

/// Membrane of a nerve cell: a fast voltage and a slow recovery.
///
///     v' = v - v^3 / 3 - w + I,   w' = epsilon (v + a - b w)
///
/// State, shape (2): v, w, without units. One equilibrium when b < 1; it oscillates where 1 - v^2 > epsilon b there.
/// Source: R. FitzHugh, "Impulses and physiological states in theoretical models of nerve membrane", Biophysical
/// Journal 1:445-466 (1961), with epsilon = 1 / c^2, I = -z and the signs of x and y such that a spike points upwards;
/// J. Nagumo, S. Arimoto, S. Yoshizawa, "An active pulse transmission line simulating nerve axon", Proceedings of the
/// IRE 50:2061-2070 (1962). Defaults: the values in common use, with a current at which the cell fires periodically.
struct FitzhughNagumo {
    static constexpr std::string_view name = "fitzhugh_nagumo";
    static constexpr std::string_view summary = "membrane of a nerve cell";
    static constexpr std::string_view equations = "v' = v - v^3 / 3 - w + I\nw' = epsilon (v + a - b w)";

    static constexpr std::array coordinates{real("v", "1"), real("w", "1")};
    static constexpr std::array parameters{Parameter{"a", "1", any_real, 0.7, "threshold of recovery"},
                                           Parameter{"b", "1", any_real, 0.8, "decay of recovery"},
                                           Parameter{"epsilon", "1/s", positive, 0.08, "rate of recovery"},
                                           Parameter{"I", "1", any_real, 0.5, "current through the membrane"}};

    template <class T>
    static State<T, 2> rhs(const T& /*t*/, const State<T, 2>& x, const Values<T, 4>& p) {
        const T& v = x[0];
        return {v * (1.0 - v * v / 3.0) - x[1] + p[3], p[2] * (v + p[0] - p[1] * x[1])};
    }
};

}  // namespace orbid::models
