#include "bench/ceres_shooting.hpp"

#include <ceres/ceres.h>

#include <chrono>
#include <cmath>
#include <ctime>
#include <limits>
#include <numbers>
#include <vector>

#include "bench/odeint_flow.hpp"

namespace orbid::bench {

namespace {

/// Residuals of one interval: readings over their sd, then the way the end misses the next node over the matching sd.
template <class E>
class IntervalCost : public ceres::CostFunction {
public:
    static constexpr std::size_t n = E::n, p = E::p;
    static constexpr std::size_t read = E::switching ? 1 : n;  ///< coordinates that are read

    IntervalCost(const ShootingTask& task, const ShootingInterval& interval) : task_(task), interval_(interval) {
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

    const ShootingTask& task_;
    const ShootingInterval& interval_;
};

template <class E>
ShootingSolution solve(const ShootingTask& task) {
    constexpr std::size_t n = E::n;
    const auto begin = std::chrono::steady_clock::now();
    ShootingSolution solution;
    solution.theta = task.theta;
    solution.nodes = task.nodes;
    ceres::Problem problem;
    for (std::size_t i = 0; i < task.intervals.size(); ++i) {
        auto* const cost = new IntervalCost<E>(task, task.intervals[i]);
        double* const node = solution.nodes.data() + i * n;
        if (task.intervals[i].linked)
            problem.AddResidualBlock(cost, nullptr, solution.theta.data(), node, node + n);
        else
            problem.AddResidualBlock(cost, nullptr, solution.theta.data(), node);
    }
    for (std::size_t i = 0; i < E::p; ++i)
        problem.SetParameterLowerBound(solution.theta.data(), static_cast<int>(i),
                                       E::switching ? (i == 0 ? 0.05 : 0.0) : 1e-3);
    ceres::Solver::Options options;
    options.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
    options.max_num_iterations = task.iterations;
    options.num_threads = task.threads;
    options.function_tolerance = 1e-9;
    options.logging_type = ceres::SILENT;
    ceres::Solver::Summary summary;
    ceres::Solve(options, &problem, &summary);
    solution.converged = summary.termination_type == ceres::CONVERGENCE;
    solution.iterations = static_cast<int>(summary.iterations.size()) - 1;
    solution.cost = summary.final_cost;
    solution.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    for (std::size_t i = 1; i < summary.iterations.size(); ++i)
        solution.iterating += summary.iterations[i].iteration_time_in_seconds;
    double count = 0.0;
    for (std::size_t i = 0; i < task.intervals.size(); ++i) {
        const ShootingInterval& interval = task.intervals[i];
        const double* const node = solution.nodes.data() + i * n;
        const double* const blocks[] = {solution.theta.data(), node, node + (interval.linked ? n : 0)};
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
double microseconds(const ShootingTask& task, std::vector<double>& ends) {
    using Flow = OdeintFlow<E, true>;
    const auto processor_seconds = [] {
        timespec now;
        clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
        return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
    };
    ends.clear();
    const double begin = processor_seconds();
    for (std::size_t i = 0; i < task.intervals.size(); ++i) {
        const auto& durations = task.intervals[i].durations;
        std::vector<typename Flow::State> states(durations.size());
        if (!Flow(task.theta.data(), task.tolerance).run(task.nodes.data() + i * E::n, 0.0, durations, states.data()))
            states.back().fill(std::numeric_limits<double>::quiet_NaN());
        ends.insert(ends.end(), states.back().begin(), states.back().begin() + E::n);
    }
    return 1e6 * (processor_seconds() - begin) / static_cast<double>(task.intervals.size());
}

}  // namespace

ShootingSolution solve_with_ceres(const ShootingTask& task) {
    return task.system == ShootingTask::System::lorenz ? solve<LorenzEquations>(task) : solve<PendulumEquations>(task);
}

double microseconds_of_odeint(const ShootingTask& task, std::vector<double>& ends) {
    return task.system == ShootingTask::System::lorenz ? microseconds<LorenzEquations>(task, ends)
                                                       : microseconds<PendulumEquations>(task, ends);
}

}  // namespace orbid::bench
