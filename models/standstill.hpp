#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "models/sticking.hpp"

namespace orbid::models {

/// f(x, phase) with the side taken from the velocity, or the image of a map. At velocity 0 the solution decides: the
/// side to which it leaves, or no acceleration while it sticks.
///
/// @param input  values of the measured inputs, nullptr for models without
template <Model M>
State<double, dimension_of<M>> value_rhs([[maybe_unused]] double phase, const State<double, dimension_of<M>>& x,
                                         const Constants<M, double>& c, [[maybe_unused]] const double* input) {
    if constexpr (MapModel<M>) {
        return M::map(x, c);
    } else {
        std::array<double, input_count_of<M>> u{};
        if constexpr (InputModel<M>) std::copy(input, input + u.size(), u.begin());
        if constexpr (SwitchingModel<M>) {
            if (x[velocity] != 0.0) return rhs_of<M, double>(phase, x, c, x[velocity] < 0.0 ? -1.0 : 1.0, u);
            const auto up = rhs_of<M, double>(phase, x, c, 1.0, u), down = rhs_of<M, double>(phase, x, c, -1.0, u);
            if (up[velocity] <= 0.0 && down[velocity] >= 0.0) {
                auto held = up;
                held[velocity] = 0.0;
                return held;
            }
            return down[velocity] < 0.0 ? down : up;
        } else {
            Side<M> side{};
            if constexpr (SurfaceModel<M>) {
                const auto h = M::surfaces(phase, x, c);
                for (std::size_t j = 0; j < h.size(); ++j)
                    side[j] = h[j] < 0.0 ? -1.0 : 1.0;
            }
            return rhs_of<M, double>(phase, x, c, side, u);
        }
    }
}

/// True when the state never moves: it sticks at every phase, or it is an equilibrium at every phase up to rounding; a
/// fixed point of a map. A model with measured inputs is never known to rest.
template <Model M>
bool stands_still(const State<double, dimension_of<M>>& x, const Values<double, parameter_count_of<M>>& p) {
    if constexpr (InputModel<M>) return false;
    const double turn = 2.0 * std::numbers::pi;
    if constexpr (SwitchingModel<M> && !InputModel<M>) {
        if (x[velocity] == 0.0) {
            const Field<M, 0> field(p, 0.0, ForcedModel<M> ? Clock::phase : Clock::time);
            if (surface_accelerations(field, x, 0.0).hold() && !release_after(field, x, 0.0, turn)) return true;
        }
    }
    // 1e-12 of the coordinate's size (at least one unit) per unit of time: rounding of an equilibrium such as phi = pi,
    // whose sine is 1e-16 in doubles.
    const auto c = constants_from<M, double>(p);
    const int samples = ForcedModel<M> ? 16 : 1;
    for (int i = 0; i < samples; ++i) {
        auto f = value_rhs<M>(turn * i / samples, x, c, nullptr);
        if constexpr (MapModel<M>)
            for (std::size_t j = 0; j < f.size(); ++j)
                f[j] -= x[j];
        for (std::size_t j = 0; j < f.size(); ++j)
            if (!(std::abs(f[j]) <= 1e-12 * (1.0 + std::abs(x[j])))) return false;
    }
    return true;
}

}  // namespace orbid::models
