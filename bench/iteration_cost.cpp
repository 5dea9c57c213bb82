// What an iteration of multiple shooting costs, ours and that of Ceres with Boost.Odeint: see identification_bench.

#include <oneapi/tbb/global_control.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <functional>
#include <limits>
#include <numbers>

#include "bench/identification_experiment.hpp"
#include "bench/ratio.hpp"
#include "orbits/series_residuals/shooting_residual.hpp"

namespace orbid::bench {

namespace {

constexpr double turn = 2.0 * std::numbers::pi;

double wall_seconds() {
    return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}
double processor_seconds() {
    timespec time;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &time);
    return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

/// Wall and processor time: the latter counts on a machine that others use too.
struct Cost {
    double wall = 0.0, processor = 0.0;
};
template <class Call>
Cost cost_of(const Call& call) {
    const double wall = wall_seconds(), processor = processor_seconds();
    call();
    return {wall_seconds() - wall, processor_seconds() - processor};
}

/// One flow with sensitivities on one thread: time, and error against single flows at 1e-14.
void compare_flows(const Experiment& e, ShootingTask task) {
    task.intervals.resize(std::min<std::size_t>(task.intervals.size(), 4096));
    const auto count = static_cast<Eigen::Index>(task.intervals.size());
    const Eigen::MatrixXd starts = Eigen::Map<const Eigen::MatrixXd>(task.nodes.data(), 2, count);
    const std::vector<double> phases(task.intervals.size(), 0.0);
    const std::vector<double> durations{e.sensor.delay, turn / 9.09};
    for (ShootingInterval& interval : task.intervals)
        interval.durations = durations;
    Eigen::VectorXd theta = e.binding.base;
    for (std::size_t i = 0; i < task.theta.size(); ++i)
        theta[e.binding.parameter[i]] = task.theta[i];
    const auto run = [&](double tolerance) {
        return e.system->flows(starts, phases, durations, theta, e.binding.parameter, models::Clock::time,
                               {tolerance, tolerance, 100000});
    };
    const auto exact = run(1e-14);
    const auto median_error = [&](const std::function<Eigen::Vector2d(std::size_t)>& end) {
        std::vector<double> errors;
        for (std::size_t k = 0; k < exact.size(); ++k) {
            const double error = (end(k) - exact[k].states.col(1)).cwiseAbs().maxCoeff();
            errors.push_back(std::isfinite(error) ? error : std::numeric_limits<double>::infinity());
        }
        std::nth_element(errors.begin(), errors.begin() + std::ssize(errors) / 2, errors.end());
        return errors[errors.size() / 2];
    };
    for (const double tolerance : {1e-9, 1e-10, 1e-11}) {
        task.tolerance = tolerance;
        std::vector<double> ends;
        const double peer = microseconds_of_odeint(task, ends);
        std::vector<models::FlowResult> flows;
        const oneapi::tbb::global_control alone(oneapi::tbb::global_control::max_allowed_parallelism, 1);
        const double us = 1e6 * cost_of([&] { flows = run(tolerance); }).processor / static_cast<double>(count);
        std::printf("  a flow at %.0e: Odeint %.1f us, median error %.1e; ours %.2f us, %.1e; ratio %.1f\n", tolerance,
                    peer, median_error([&](std::size_t k) { return Eigen::Vector2d(ends[2 * k], ends[2 * k + 1]); }),
                    us, median_error([&](std::size_t k) { return Eigen::Vector2d(flows[k].states.col(1)); }),
                    peer / us);
    }
}

}  // namespace

void compare_iterations(std::size_t sections) {
    const Experiment e = pendulum_experiment(sections);
    std::printf("one iteration on %zu sections, %d threads\n", e.series.size(), threads());
    ShootingTask task = shooting_task(e, 1, 1 << 30);
    const Eigen::VectorXd start = 1.01 * e.truth;
    task.theta.assign(start.begin(), start.end());
    task.matching_sd = {1e-3, 5e-3};
    auto parameters = e.parameters;
    for (std::size_t i = 0; i < parameters.size(); ++i)
        parameters[i].start = start[static_cast<Eigen::Index>(i)];
    for (const double tolerance : {1e-9, 1e-11}) {
        task.tolerance = tolerance;
        // Differences between runs of different lengths leave out what is done once.
        const auto peer_run = [&](int iterations) {
            task.iterations = iterations;
            ShootingSolution solution;
            const Cost cost = cost_of([&] { solution = solve_with_ceres(task); });
            return std::pair(solution, cost);
        };
        const auto [one, one_cost] = peer_run(1);
        const auto [five, five_cost] = peer_run(5);
        const double more = five.iterations - one.iterations;
        const Cost peer{(five_cost.wall - one_cost.wall) / more, (five_cost.processor - one_cost.processor) / more};
        std::printf("  tolerance %.0e: Ceres %.3f s per iteration, %.3f s of processor time (%d iterations)\n",
                    tolerance, peer.wall, peer.processor, five.iterations);
        orbits::ShootingOptions shooting;
        shooting.sensor = e.sensor;
        shooting.start = start;
        shooting.flow = {tolerance, tolerance, 100000};
        const auto evaluation = [&](bool derivatives) {
            const orbits::ShootingResidual residual(e.system, e.binding, e.series, shooting);
            const auto latents = residual.initial_latents();
            const auto active = residual.initial_set();
            return cost_of([&] { (void)residual.evaluate(active, start, latents, derivatives); });
        };
        const Cost plain = evaluation(false), full = evaluation(true);
        const auto our_run = [&](int iterations) {
            orbits::ShootingResidual residual(e.system, e.binding, e.series, shooting);
            estimator::EstimateOptions options;
            options.verdict = false;
            options.clusters = estimator::Clusters::none;
            options.maximum_iterations = iterations;
            int taken = 0;
            const Cost cost = cost_of([&] { taken = estimate(parameters, {&residual}, {}, options).iterations; });
            return std::pair(taken, cost);
        };
        const auto [few, few_cost] = our_run(2);
        const auto [many, many_cost] = our_run(6);
        const Cost us{(many_cost.wall - few_cost.wall) / (many - few),
                      (many_cost.processor - few_cost.processor) / (many - few)};
        std::printf("    ours: evaluation %.3f s (processor %.3f s), with derivatives %.3f s (%.3f s)\n", plain.wall,
                    plain.processor, full.wall, full.processor);
        char task_name[80];
        std::snprintf(task_name, sizeof task_name, "an iteration on %zu sections, 4 parameters, flows to %.0e",
                      e.series.size(), tolerance);
        print_ratio(task_name, "Ceres", us.processor, peer.processor, "s of the processor");
        std::printf("    Ceres over two evaluations of ours, all that flows cost: %.1f\n",
                    peer.processor / (plain.processor + full.processor));
    }
    compare_flows(e, task);
}

}  // namespace orbid::bench
