#pragma once

#include <algorithm>
#include <cstddef>
#include <span>
#include <vector>

#include "models/trajectory.hpp"

namespace orbid::models {

/// Directions carried at once: those of the start (they are part of the step control) and two or six parameters. Few
/// parameters do not pay for eight directions, more are taken in several passes.
template <Model M>
inline constexpr std::size_t narrow_chunk = dimension_of<M> + 2;
template <Model M>
inline constexpr std::size_t wide_chunk = dimension_of<M> + 6;

template <class T, std::size_t n>
std::array<T, n> array_from(const Eigen::VectorXd& x) {
    std::array<T, n> a;
    for (std::size_t i = 0; i < n; ++i)
        a[i] = x[static_cast<Eigen::Index>(i)];
    return a;
}

/// Sets partials for the directions of the start and the free parameters [first, first + N - n).
template <std::size_t N, std::size_t n, std::size_t q>
void seed(State<Dual<N>, n>& x, Values<Dual<N>, q>& p, std::span<const Eigen::Index> free, std::size_t first) {
    for (std::size_t i = 0; i < n; ++i)
        x[i].partial[i] = 1.0;
    for (std::size_t i = n; i < N && first + i - n < free.size(); ++i)
        p[static_cast<std::size_t>(free[first + i - n])].partial[i] = 1.0;
}

/// One solution at all durations; the columns of `result.sensitivities` for the start and the free parameters
/// [first, first + N - n), unless it has no columns. `result` has its shapes already; everything else in it is
/// overwritten with the same values at each pass.
template <Model M, std::size_t N>
void flow_pass(const Eigen::VectorXd& x0, double phase, std::span<const double> durations, const Eigen::VectorXd& theta,
               std::span<const Eigen::Index> free, std::size_t first, Clock clock, const FlowOptions& options,
               FlowResult& result) {
    constexpr std::size_t n = dimension_of<M>;
    constexpr std::size_t q = parameter_count_of<M>;
    auto x = array_from<Scalar<N>, n>(x0);
    auto p = array_from<Scalar<N>, q>(theta);
    seed<N, n, q>(x, p, free, first);
    const std::size_t directions = result.sensitivities.cols() > 0 ? n + free.size() : 0;
    Trajectory<M, N> trajectory(p, x, phase, clock, options);
    result.status = FlowStatus::ok;
    for (std::size_t k = 0; k < durations.size() && result.status == FlowStatus::ok; ++k) {
        result.status = trajectory.advance(durations[k]);
        if (result.status != FlowStatus::ok) break;
        for (std::size_t i = 0; i < n; ++i) {
            const auto row = static_cast<Eigen::Index>(i);
            result.states(row, static_cast<Eigen::Index>(k)) = value_of(trajectory.state()[i]);
            if (directions == 0) continue;
            for (std::size_t j = 0; j < N && (j < n || first + j < directions); ++j) {
                const std::size_t direction = j < n ? j : first + j;
                result.sensitivities(row, static_cast<Eigen::Index>(k * directions + direction)) =
                    trajectory.state()[i].partial[j];
            }
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
