#include <ceres/ceres.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <ctime>
#include <limits>
#include <numbers>
#include <span>
#include <vector>

#include "bench/ceres/odeint_flow.hpp"
#include "bench/ceres/peer.h"

namespace orbid::bench {

namespace {

/// One interval of a task.
struct Interval {
    std::span<const double> durations, readings;
    bool linked = false;
};

template <class E>
constexpr std::size_t coordinates_read = E::switching ? 1 : E::n;

template <class E>
std::vector<Interval> intervals_of(const peer_shooting_task& task) {
    std::vector<Interval> intervals;
    std::size_t begin = 0;
    for (int i = 0; i < task.intervals; ++i) {
        const auto end = static_cast<std::size_t>(task.ends[i]);
        const std::span durations(task.durations + begin, end - begin);
        const std::span readings(task.readings + begin * coordinates_read<E>, durations.size() * coordinates_read<E>);
        intervals.push_back({durations, readings, task.linked[i] != 0});
        begin = end;
    }
    return intervals;
}

/// Residuals of one interval: readings over their sd, then the way the end misses the next node over the matching sd.
template <class E>
class IntervalCost : public ceres::CostFunction {
public:
    static constexpr std::size_t n = E::n, p = E::p;
    static constexpr std::size_t read = coordinates_read<E>;

    IntervalCost(const peer_shooting_task& task, const Interval& interval) : task_(task), interval_(interval) {
        set_num_residuals(static_cast<int>(interval.readings.size() + (interval.linked ? n : 0)));
        mutable_parameter_block_sizes()->push_back(static_cast<int>(p));
        mutable_parameter_block_sizes()->push_back(static_cast<int>(n));
        if (interval.linked) mutable_parameter_block_sizes()->push_back(static_cast<int>(n));
    }
    bool Evaluate(double const* const* x, double* e, double** jacobians) const override {
        return jacobians == nullptr ? evaluate<false>(x, e, nullptr) : evaluate<true>(x, e, jacobians);
    }

private:
    template <bool derivatives>
    bool evaluate(double const* const* x, double* e, double** jacobians) const {
        using Flow = OdeintFlow<E, derivatives>;
        std::vector<typename Flow::State> states(interval_.durations.size());
        if (!Flow(x[0], task_.tolerance).run(x[1], 0.0, interval_.durations, states.data())) return false;
        std::size_t row = 0;
        const auto write = [&](const typename Flow::State& state, std::size_t i, double target, double sd, bool angle) {
            double difference = state[i] - target;
            if (angle) difference = std::remainder(difference, 2.0 * std::numbers::pi);
            e[row] = difference / sd;
            if constexpr (derivatives) {
                if (jacobians[0] != nullptr)
                    for (std::size_t j = 0; j < p; ++j)
                        jacobians[0][row * p + j] = state[n + (n + j) * n + i] / sd;
                if (jacobians[1] != nullptr)
                    for (std::size_t j = 0; j < n; ++j)
                        jacobians[1][row * n + j] = state[n + j * n + i] / sd;
            }
            ++row;
        };
        for (std::size_t k = 0; k < states.size(); ++k)
            for (std::size_t i = 0; i < read; ++i) {
                const double reading = interval_.readings[k * read + i];
                const bool missing = !std::isfinite(reading);
                write(states[k], i, missing ? states[k][i] : reading,
                      missing ? std::numeric_limits<double>::infinity() : task_.reading_sd, E::switching);
            }
        if (interval_.linked) {
            if (derivatives && jacobians[2] != nullptr) {
                const std::size_t rows = static_cast<std::size_t>(num_residuals());
                std::fill(jacobians[2], jacobians[2] + rows * n, 0.0);
                for (std::size_t i = 0; i < n; ++i)
                    jacobians[2][(row + i) * n + i] = -1.0 / task_.matching_sd[i];
            }
            for (std::size_t i = 0; i < n; ++i)
                write(states.back(), i, x[2][i], task_.matching_sd[i], E::switching && i == 0);
        }
        return true;
    }

    const peer_shooting_task& task_;
    const Interval& interval_;
};

template <class E>
peer_shooting_result solve(const peer_shooting_task& task, double* theta, double* nodes) {
    constexpr std::size_t n = E::n;
    const auto begin = std::chrono::steady_clock::now();
    peer_shooting_result solution{};
    const std::vector<Interval> intervals = intervals_of<E>(task);
    ceres::Problem problem;
    for (std::size_t i = 0; i < intervals.size(); ++i) {
        auto* const cost = new IntervalCost<E>(task, intervals[i]);
        double* const node = nodes + i * n;
        if (intervals[i].linked)
            problem.AddResidualBlock(cost, nullptr, theta, node, node + n);
        else
            problem.AddResidualBlock(cost, nullptr, theta, node);
    }
    for (std::size_t i = 0; i < E::p; ++i)
        problem.SetParameterLowerBound(theta, static_cast<int>(i), E::switching ? (i == 0 ? 0.05 : 0.0) : 1e-3);
    ceres::Solver::Options options;
    options.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
    options.max_num_iterations = task.iterations;
    options.num_threads = task.threads;
    options.function_tolerance = 1e-9;
    options.logging_type = ceres::SILENT;
    ceres::Solver::Summary summary;
    ceres::Solve(options, &problem, &summary);
    solution.converged = summary.termination_type == ceres::CONVERGENCE ? 1 : 0;
    solution.iterations = static_cast<int>(summary.iterations.size()) - 1;
    solution.cost = summary.final_cost;
    solution.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    for (std::size_t i = 1; i < summary.iterations.size(); ++i)
        solution.iterating += summary.iterations[i].iteration_time_in_seconds;
    double count = 0.0;
    for (std::size_t i = 0; i < intervals.size(); ++i) {
        const Interval& interval = intervals[i];
        const double* const node = nodes + i * n;
        const double* const blocks[] = {theta, node, node + (interval.linked ? n : 0)};
        std::vector<double> e(interval.readings.size() + n);
        if (!IntervalCost<E>(task, interval).Evaluate(blocks, e.data(), nullptr))
            e[0] = std::numeric_limits<double>::infinity();
        for (std::size_t k = 0; k < interval.readings.size(); ++k)
            if (std::isfinite(interval.readings[k])) {
                solution.readings_chi2 += e[k] * e[k];
                ++count;
            }
    }
    solution.readings_chi2 /= count;
    solution.derivatives = summary.jacobian_evaluation_time_in_seconds;
    solution.linear = summary.linear_solver_time_in_seconds;
    return solution;
}

template <class E>
double microseconds(const peer_shooting_task& task, const double* theta, const double* nodes, double* ends) {
    using Flow = OdeintFlow<E, true>;
    const auto processor_seconds = [] {
        timespec now;
        clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
        return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
    };
    const std::vector<Interval> intervals = intervals_of<E>(task);
    const double begin = processor_seconds();
    for (std::size_t i = 0; i < intervals.size(); ++i) {
        const auto& durations = intervals[i].durations;
        std::vector<typename Flow::State> states(durations.size());
        if (!Flow(theta, task.tolerance).run(nodes + i * E::n, 0.0, durations, states.data()))
            states.back().fill(std::numeric_limits<double>::quiet_NaN());
        std::copy_n(states.back().begin(), E::n, ends + i * E::n);
    }
    return 1e6 * (processor_seconds() - begin) / static_cast<double>(intervals.size());
}

}  // namespace

}  // namespace orbid::bench

peer_shooting_result peer_solve_shooting(const peer_shooting_task* task, double* theta, double* nodes) {
    using namespace orbid::bench;
    return task->pendulum != 0 ? solve<PendulumEquations>(*task, theta, nodes)
                               : solve<LorenzEquations>(*task, theta, nodes);
}

double peer_flow_microseconds(const peer_shooting_task* task, const double* theta, const double* nodes, double* ends) {
    using namespace orbid::bench;
    return task->pendulum != 0 ? microseconds<PendulumEquations>(*task, theta, nodes, ends)
                               : microseconds<LorenzEquations>(*task, theta, nodes, ends);
}
