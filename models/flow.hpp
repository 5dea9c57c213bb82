#pragma once

#include <algorithm>
#include <cstddef>
#include <span>
#include <vector>

#include "models/trajectory.hpp"

namespace orbid::models {

/// Width of the chunks in which directions of derivative are carried: few directions (a state of two coordinates and
/// two parameters) do not pay for eight.
inline constexpr std::size_t narrow_chunk = 4;
inline constexpr std::size_t wide_chunk = 8;

template <class T, std::size_t n>
std::array<T, n> array_from(const Eigen::VectorXd& x) {
    std::array<T, n> a;
    for (std::size_t i = 0; i < n; ++i)
        a[i] = x[static_cast<Eigen::Index>(i)];
    return a;
}

/// Sets partials so that directions [first, first + N) of (x0, free parameters) are carried.
template <std::size_t N, std::size_t n, std::size_t q>
void seed(State<Dual<N>, n>& x, Values<Dual<N>, q>& p, std::span<const Eigen::Index> free, std::size_t first) {
    for (std::size_t i = 0; i < N; ++i) {
        const std::size_t direction = first + i;
        if (direction < n)
            x[direction].partial[i] = 1.0;
        else if (direction < n + free.size())
            p[static_cast<std::size_t>(free[direction - n])].partial[i] = 1.0;
    }
}

/// One solution at all durations; with N > 0 the columns of `result.sensitivities` for directions [first, first + N).
/// `result` has its shapes already. Everything else in it is overwritten with the same values at each pass.
template <Model M, std::size_t N>
void flow_pass(const Eigen::VectorXd& x0, double phase, std::span<const double> durations, const Eigen::VectorXd& theta,
               std::span<const Eigen::Index> free, std::size_t first, Clock clock, const FlowOptions& options,
               FlowResult& result) {
    constexpr std::size_t n = dimension_of<M>;
    constexpr std::size_t q = parameter_count_of<M>;
    auto x = array_from<Scalar<N>, n>(x0);
    auto p = array_from<Scalar<N>, q>(theta);
    if constexpr (N > 0) seed<N, n, q>(x, p, free, first);
    const std::size_t directions = n + free.size();
    Trajectory<M, N> trajectory(p, x, phase, clock, options);
    result.status = FlowStatus::ok;
    for (std::size_t k = 0; k < durations.size() && result.status == FlowStatus::ok; ++k) {
        result.status = trajectory.advance(durations[k]);
        if (result.status != FlowStatus::ok) break;
        for (std::size_t i = 0; i < n; ++i) {
            const auto row = static_cast<Eigen::Index>(i);
            result.states(row, static_cast<Eigen::Index>(k)) = value_of(trajectory.state()[i]);
            if constexpr (N > 0)
                for (std::size_t j = 0; j < N && first + j < directions; ++j)
                    result.sensitivities(row, static_cast<Eigen::Index>(k * directions + first + j)) =
                        trajectory.state()[i].partial[j];
        }
    }
    result.stopped_after = trajectory.s();
    result.stopped_state.resize(n);
    for (std::size_t i = 0; i < n; ++i)
        result.stopped_state[static_cast<Eigen::Index>(i)] = value_of(trajectory.state()[i]);
    result.steps = trajectory.steps();
    result.crossings = trajectory.crossings();
    result.stickings = trajectory.stickings();
}

}  // namespace orbid::models
