#pragma once

#include <cmath>
#include <cstddef>
#include <span>

#include "models/trajectories/flow.hpp"

namespace orbid::models {

/// Iterates of a map with derivatives in N directions, the counterpart of flow_pass(). Durations are whole numbers of
/// iterations; each counts as a step.
template <MapModel M, std::size_t N, std::size_t order = 1>
FlowEnd map_pass(const FlowStart& start, std::span<const double> durations, std::span<const std::ptrdiff_t> free,
                 std::size_t first, const FlowOutput& output, [[maybe_unused]] std::size_t second = 0) {
    constexpr std::size_t n = dimension_of<M>;
    constexpr std::size_t q = parameter_count_of<M>;
    auto x = array_from<Scalar<N, order>, n>(start.state);
    auto p = array_from<Scalar<N, order>, q>(start.theta);
    seed<N, n, q>(x, p, free, first);
    if constexpr (order == 2) seed_second<N, n, q>(x, p, free, second);
    const std::size_t directions = n + free.size();
    const auto c = constants_from<M, Scalar<N, order>>(p);
    FlowEnd end;
    const auto finite = [&x] {
        for (const auto& component : x)
            if (!std::isfinite(value_of(component))) return false;
        return true;
    };
    for (std::size_t k = 0; k < durations.size() && end.status == FlowStatus::ok; ++k) {
        while (end.stopped_after < durations[k] && end.status == FlowStatus::ok) {
            if (end.steps >= start.options.maximum_steps) {
                end.status = FlowStatus::step_budget;
                break;
            }
            ++end.steps;
            x = M::map(x, c);
            if (!finite()) end.status = FlowStatus::not_finite;
            end.stopped_after += 1.0;
        }
        if (end.status != FlowStatus::ok) break;
        for (std::size_t i = 0; i < n; ++i)
            output.states[k * n + i] = value_of(x[i]);
        if (output.sensitivities != nullptr)
            store_partials<N, n>(x, first, directions, output.sensitivities + k * directions * n);
        if constexpr (order == 2)
            store_second<N, n>(x, first, directions,
                               output.second_derivatives + (k * directions + second) * directions * n);
    }
    for (std::size_t i = 0; i < n; ++i)
        output.stopped_state[i] = value_of(x[i]);
    return end;
}

}  // namespace orbid::models
