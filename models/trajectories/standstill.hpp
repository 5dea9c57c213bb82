#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "models/trajectories/sticking.hpp"
#include "models/trajectories/surface_field.hpp"

namespace orbid::models {

/// f(x, phase) per second of a model with general surfaces, on the sides given by their h. On a surface the solution
/// decides: the sides to which it leaves, or the field of its sliding. The sides are +1 where it cannot continue.
template <SurfaceModel M>
State<double, dimension_of<M>> surface_rhs(double phase, const State<double, dimension_of<M>>& x,
                                           const Values<double, parameter_count_of<M>>& p,
                                           const Constants<M, double>& c,
                                           const std::array<double, input_count_of<M>>& u, const M& model = M()) {
    constexpr std::size_t n = dimension_of<M>;
    constexpr std::size_t m = surface_count_of<M>;
    using Moving = Dual<1>;
    const auto h = model.surfaces(phase, x, c);
    constexpr auto impacts = impacts_of<M>();
    Side<M> side;
    std::array<bool, m> on{};
    for (std::size_t j = 0; j < m; ++j) {
        side[j] = h[j] < 0.0 && !impacts[j] ? -1.0 : 1.0;
        on[j] = h[j] == 0.0 && !impacts[j];
    }
    const auto f = [&](const Side<M>& sides) { return rhs_of<M, double>(phase, x, c, sides, u, model); };
    const auto rates = [&](const Side<M>& sides) {
        const auto slope = f(sides);
        State<Moving, n> y;
        for (std::size_t i = 0; i < n; ++i)
            y[i] = Moving(x[i], {slope[i]});
        double time_rate = 1.0;
        if constexpr (ForcedModel<M>) time_rate = p[M::forcing_frequency];
        const auto moving = model.surfaces(Moving(phase, {time_rate}), y, constants_as<Moving>(c));
        std::array<double, m> rate;
        for (std::size_t j = 0; j < m; ++j)
            rate[j] = moving[j].partial[0];
        return rate;
    };
    const auto next = continuation<m>(on, impacts, side, rates);
    if (!next) return f(side);
    if (next->held == m) return f(next->side);
    Side<M> up = next->side, down = next->side;
    up[next->held] = 1.0;
    down[next->held] = -1.0;
    const auto above = f(up), below = f(down);
    const double from_above = rates(up)[next->held], from_below = rates(down)[next->held];
    State<double, n> sliding;
    for (std::size_t i = 0; i < n; ++i)
        sliding[i] = (from_above * below[i] - from_below * above[i]) / (from_above - from_below);
    return sliding;
}

/// f(x, phase) with the side of the velocity, or the image of a map. At velocity 0 the solution decides: the side to
/// which it leaves, or no acceleration while it sticks.
///
/// @param input  values of the measured inputs, nullptr for models without
template <Model M>
State<double, dimension_of<M>> value_rhs([[maybe_unused]] double phase, const State<double, dimension_of<M>>& x,
                                         const Values<double, parameter_count_of<M>>& p,
                                         [[maybe_unused]] const double* input, const M& model = M()) {
    const auto c = constants_from<M, double>(p, model);
    if constexpr (MapModel<M>) {
        return model.map(x, c);
    } else {
        std::array<double, input_count_of<M>> u{};
        if constexpr (InputModel<M>) std::copy(input, input + u.size(), u.begin());
        if constexpr (SwitchingModel<M>) {
            if (x[velocity] != 0.0) return rhs_of<M, double>(phase, x, c, x[velocity] < 0.0 ? -1.0 : 1.0, u, model);
            const auto up = rhs_of<M, double>(phase, x, c, 1.0, u, model);
            const auto down = rhs_of<M, double>(phase, x, c, -1.0, u, model);
            if (up[velocity] <= 0.0 && down[velocity] >= 0.0) {
                auto held = up;
                held[velocity] = 0.0;
                return held;
            }
            return down[velocity] < 0.0 ? down : up;
        } else {
            if constexpr (SurfaceModel<M>)
                return surface_rhs<M>(phase, x, p, c, u, model);
            else
                return rhs_of<M, double>(phase, x, c, {}, u, model);
        }
    }
}

/// True when the state never moves: it sticks at every phase, is an equilibrium at every phase up to rounding, or is a
/// fixed point of a map. General surfaces: the field, or that of sliding, is 0 at every one of some phases. A model
/// with measured inputs is never known to rest.
template <Model M>
bool stands_still(const State<double, dimension_of<M>>& x, const Values<double, parameter_count_of<M>>& p,
                  const M& model = M()) {
    if constexpr (InputModel<M>) return false;
    const double turn = 2.0 * std::numbers::pi;
    if constexpr (SwitchingModel<M> && !InputModel<M>) {
        if (x[velocity] == 0.0) {
            const Field<M, 0> field(p, 0.0, ForcedModel<M> ? Clock::phase : Clock::time, model);
            if (surface_accelerations(field, x, 0.0).hold() && !release_after(field, x, 0.0, turn)) return true;
        }
    }
    // 1e-12 of the coordinate's size (at least one unit) per unit of time. This is the rounding of an equilibrium such
    // as phi = pi, whose sine is 1e-16 in doubles. Where surfaces hold the state, it may be released in a part of the
    // period only, as in release_after().
    const int samples = !ForcedModel<M> ? 1 : SurfaceModel<M> ? 128 : 16;
    for (int i = 0; i < samples; ++i) {
        auto f = value_rhs<M>(turn * i / samples, x, p, nullptr, model);
        if constexpr (MapModel<M>)
            for (std::size_t j = 0; j < f.size(); ++j)
                f[j] -= x[j];
        for (std::size_t j = 0; j < f.size(); ++j)
            if (!(std::abs(f[j]) <= 1e-12 * (1.0 + std::abs(x[j])))) return false;
    }
    return true;
}

}  // namespace orbid::models
