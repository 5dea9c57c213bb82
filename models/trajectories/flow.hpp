#pragma once

#include <cmath>
#include <cstddef>
#include <span>

#include "models/system/kernel.hpp"
#include "models/system/stopped.hpp"
#include "models/trajectories/implicit_trajectory.hpp"
#include "models/trajectories/surface_trajectory.hpp"
#include "models/trajectories/trajectory.hpp"

namespace orbid::models {

/// Directions carried at once: those of the start (they are part of the step control) and as many parameters as fill
/// vector registers, at least one or five. Eight directions do not pay for few parameters; more parameters are taken in
/// several passes.
template <Model M>
inline constexpr std::size_t narrow_chunk = (dimension_of<M> / 4 + 1) * 4;
template <Model M>
inline constexpr std::size_t wide_chunk = narrow_chunk<M> + 4;

template <class T, std::size_t n>
std::array<T, n> array_from(const double* x) {
    std::array<T, n> a;
    for (std::size_t i = 0; i < n; ++i)
        a[i] = x[i];
    return a;
}

/// Sets partials for the directions of the start and the free parameters [first, first + N - n).
template <std::size_t N, std::size_t n, std::size_t q, class T>
void seed(State<T, n>& x, Values<T, q>& p, std::span<const std::ptrdiff_t> free, std::size_t first) {
    for (std::size_t i = 0; i < n; ++i)
        first_order(x[i]).partial[i] = 1.0;
    for (std::size_t i = n; i < N && first + i - n < free.size(); ++i)
        first_order(p[static_cast<std::size_t>(free[first + i - n])]).partial[i] = 1.0;
}

/// Sets the partial of the one direction of second derivatives: a coordinate of the start, or a free parameter.
template <std::size_t N, std::size_t n, std::size_t q>
void seed_second(State<Scalar<N, 2>, n>& x, Values<Scalar<N, 2>, q>& p, std::span<const std::ptrdiff_t> free,
                 std::size_t direction) {
    (direction < n ? x[direction] : p[static_cast<std::size_t>(free[direction - n])]).partial[0].value = 1.0;
}

/// Copies the partials of a pass that began with the free parameter `first` into columns of a matrix of n rows. Column
/// j holds those of the start's directions, column first + j the others.
template <std::size_t N, std::size_t n, class T>
void store_partials(const State<T, n>& x, std::size_t first, std::size_t directions, double* columns) {
    for (std::size_t j = 0; j < N && (j < n || first + j < directions); ++j)
        for (std::size_t i = 0; i < n; ++i)
            columns[(j < n ? j : first + j) * n + i] = first_order(x[i]).partial[j];
}

/// The same for the derivatives of the partial in the one direction of second derivatives.
template <std::size_t N, std::size_t n>
void store_second(const State<Scalar<N, 2>, n>& x, std::size_t first, std::size_t directions, double* columns) {
    State<Dual<N>, n> partial;
    for (std::size_t i = 0; i < n; ++i)
        partial[i] = x[i].partial[0];
    store_partials<N, n>(partial, first, directions, columns);
}

/// The state x at the duration of number k, and its derivatives as far as they are asked for.
template <std::size_t N, std::size_t n, std::size_t order>
void store_solution(const State<Scalar<N, order>, n>& x, std::size_t k, std::size_t first,
                    [[maybe_unused]] std::size_t second, std::size_t directions, const FlowOutput& output) {
    for (std::size_t i = 0; i < n; ++i)
        output.states[k * n + i] = value_of(x[i]);
    if constexpr (N > 0) {
        if (output.sensitivities != nullptr)
            store_partials<N, n>(x, first, directions, output.sensitivities + k * directions * n);
    }
    if constexpr (order == 2)
        store_second<N, n>(x, first, directions,
                           output.second_derivatives + (k * directions + second) * directions * n);
}

/// Calls pass<N>(first) until all free parameters are done.
template <Model M, class Pass>
void in_passes(std::size_t free, const Pass& pass) {
    constexpr std::size_t n = dimension_of<M>;
    std::size_t first = 0;
    do {
        if (free - first <= narrow_chunk<M> - n) {
            pass.template operator()<narrow_chunk<M>>(first);
            first += narrow_chunk<M> - n;
        } else {
            pass.template operator()<wide_chunk<M>>(first);
            first += wide_chunk<M> - n;
        }
    } while (first < free);
}

/// Calls pass<N>(first, direction) for every direction of second derivatives until all free parameters are done. One
/// width only, as this compiles to much code.
template <Model M, class Pass>
void in_second_order_passes(std::size_t free, const Pass& pass) {
    constexpr std::size_t n = dimension_of<M>;
    constexpr std::size_t N = wide_chunk<M>;
    for (std::size_t direction = 0; direction < n + free; ++direction)
        for (std::size_t first = 0; first == 0 || first < free; first += N - n)
            pass.template operator()<N>(first, direction);
}

namespace detail {
template <class M, std::size_t N, std::size_t order>
struct TrajectoryChoice {
    using type = Trajectory<M, N, order>;
};
template <SurfaceModel M, std::size_t N, std::size_t order>
struct TrajectoryChoice<M, N, order> {
    static_assert(!StiffModel<M>, "a stiff model must be smooth: implicit steps do not look for switching surfaces");
    using type = SurfaceTrajectory<M, N, order>;
};
template <class M, std::size_t N, std::size_t order>
requires(StiffModel<M> && !SurfaceModel<M>) struct TrajectoryChoice<M, N, order> {
    using type = ImplicitTrajectory<M, N, order>;
};
}  // namespace detail

/// The class that computes the solutions of a model.
template <Model M, std::size_t N, std::size_t order = 1>
using TrajectoryOf = typename detail::TrajectoryChoice<M, N, order>::type;

/// One solution at all durations, with the columns of the sensitivities for the start and the free parameters [first,
/// first + N - n), if asked for. For order 2 also the second derivatives in `second` and those directions. Each pass
/// overwrites everything else in the output with the same values.
template <Model M, std::size_t N, std::size_t order = 1>
FlowEnd flow_pass(const FlowStart& start, std::span<const double> durations, std::span<const std::ptrdiff_t> free,
                  std::size_t first, const FlowOutput& output, [[maybe_unused]] std::size_t second = 0,
                  const M& model = M()) {
    constexpr std::size_t n = dimension_of<M>;
    constexpr std::size_t q = parameter_count_of<M>;
    auto x = array_from<Scalar<N, order>, n>(start.state);
    auto p = array_from<Scalar<N, order>, q>(start.theta);
    if constexpr (N > 0) seed<N, n, q>(x, p, free, first);
    if constexpr (order == 2) seed_second<N, n, q>(x, p, free, second);
    const std::size_t directions = n + free.size();
    TrajectoryOf<M, N, order> trajectory(p, x, start.phase, start.clock, start.options, start.input, model);
    FlowEnd end;
    for (std::size_t k = 0; k < durations.size() && end.status == FlowStatus::ok; ++k) {
        end.status = trajectory.advance(durations[k]);
        if (end.status != FlowStatus::ok) break;
        store_solution<N, n, order>(trajectory.state(), k, first, second, directions, output);
    }
    if constexpr (N > 0) {
        // Derivatives that were not asked for still take part in the choice of steps. On long chaotic motion they
        // overflow (Lorenz: after 768 s), while the values alone need not.
        if (output.sensitivities == nullptr && end.status == FlowStatus::not_finite)
            return flow_pass<M, 0>(start, durations, free, first, output, 0, model);
    }
    end.stopped_after = trajectory.s();
    for (std::size_t i = 0; i < n; ++i)
        output.stopped_state[i] = value_of(trajectory.state()[i]);
    end.steps = trajectory.steps();
    end.crossings = trajectory.crossings();
    end.stickings = trajectory.stickings();
    return end;
}

/// The same for the iterates of a map. Durations are whole numbers of iterations; each counts as a step.
template <MapModel M, std::size_t N, std::size_t order = 1>
FlowEnd flow_pass(const FlowStart& start, std::span<const double> durations, std::span<const std::ptrdiff_t> free,
                  std::size_t first, const FlowOutput& output, [[maybe_unused]] std::size_t second = 0,
                  const M& model = M()) {
    constexpr std::size_t n = dimension_of<M>;
    constexpr std::size_t q = parameter_count_of<M>;
    auto x = array_from<Scalar<N, order>, n>(start.state);
    auto p = array_from<Scalar<N, order>, q>(start.theta);
    seed<N, n, q>(x, p, free, first);
    if constexpr (order == 2) seed_second<N, n, q>(x, p, free, second);
    const std::size_t directions = n + free.size();
    const auto c = constants_from<M, Scalar<N, order>>(p, model);
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
            // An iteration takes some nanoseconds.
            if (end.steps++ % 1024 == 0) stop_if_asked(start.options.interrupted);
            x = model.map(x, c);
            if (!finite()) end.status = FlowStatus::not_finite;
            end.stopped_after += 1.0;
        }
        if (end.status != FlowStatus::ok) break;
        store_solution<N, n, order>(x, k, first, second, directions, output);
    }
    for (std::size_t i = 0; i < n; ++i)
        output.stopped_state[i] = value_of(x[i]);
    return end;
}

}  // namespace orbid::models
