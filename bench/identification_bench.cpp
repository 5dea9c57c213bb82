// Identification from recorded series, ours against what else there is, in one run:
//   - single shooting (Ceres, one initial state per segment): how far it goes;
//   - multiple shooting with Ceres and Boost.Odeint, as a user writes it;
//   - the paper's method: cycles by closest returns, equal weights, re-solved orbits;
//   - ours: prediction over one interval, then the series residual.
//
//   identification_bench [lorenz] [pendulum [SECTIONS]] [iteration [SECTIONS]]     default: all, 5000, 42754
//
// Experiments: Lorenz' equations, 30 s every 0.01 s, all states read with noise 0.5, from (1, 2.2, 0.2) (true 10, 28,
// 2.66); the parametric pendulum with dry friction, sections read by an encoder of 4096 steps, now and 15.08 ms later,
// l, k1, k2, k3 unknown.

#include <oneapi/tbb/global_control.h>
#include <oneapi/tbb/info.h>

#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <memory>
#include <numbers>
#include <set>
#include <string>
#include <vector>

#include "bench/ceres_shooting.hpp"
#include "estimator/estimate.hpp"
#include "models/registry.hpp"
#include "orbits/cycle_residual.hpp"
#include "orbits/cycle_search.hpp"
#include "orbits/node_state.hpp"
#include "orbits/prediction_residual.hpp"
#include "orbits/shooting_residual.hpp"
#include "orbits/virtual_experiment.hpp"

namespace orbid::bench {

namespace {

constexpr double turn = 2.0 * std::numbers::pi;

double now() {
    return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

struct Experiment {
    std::shared_ptr<const models::System> system;
    models::ParameterBinding binding;
    std::vector<estimator::FreeParameter> parameters;
    Eigen::VectorXd truth;
    orbits::Series series;
    models::Sensor sensor;
};

void free_parameter(Experiment& e, const std::string& name, double start, double lower) {
    const Eigen::Index index = e.system->parameter_index(name);
    estimator::FreeParameter p;
    p.name = name;
    p.start = start;
    p.lower = lower;
    p.typical_size = e.system->parameters()[static_cast<std::size_t>(index)].typical_size;
    e.binding.parameter.push_back(index);
    e.binding.estimated.push_back(e.binding.estimated_count++);
    e.parameters.push_back(p);
    e.truth.conservativeResize(e.binding.estimated_count);
    e.truth[e.binding.estimated_count - 1] = e.binding.base[index];
}

Experiment lorenz() {
    Experiment e;
    e.system = models::make_system("lorenz");
    e.binding.base = Eigen::Vector3d(10.0, 28.0, 2.66);
    orbits::VirtualExperimentOptions options;
    options.plan = orbits::SamplePlan{0.01, 3001, 0};
    options.initial = Eigen::Vector3d(1.0, 0.0, 0.0);
    options.noise = Eigen::Vector3d::Constant(0.5);
    options.seed = 1;
    e.series = orbits::simulate(*e.system, e.binding.base, options).series;
    free_parameter(e, "sigma", 1.0, 0.0);
    free_parameter(e, "rho", 2.2, 0.0);
    free_parameter(e, "beta", 0.2, 0.0);
    return e;
}

Experiment pendulum(std::size_t sections) {
    Experiment e;
    e.system = models::make_system("parametric_pendulum");
    e.binding.base = e.system->default_parameters();
    e.binding.base[e.system->parameter_index("k1")] = 1e-3;
    orbits::VirtualExperimentOptions options;
    options.plan = orbits::SectionPlan{sections, 20, {}, 0.0};
    options.seed = 1;
    options.flow = {1e-11, 1e-11, 100000};
    options.sensor.type = models::Sensor::Type::angle_difference;
    options.sensor.delay = 0.01508;
    options.sensor.step = turn / 4096.0;
    options.sensor.rounding = models::Sensor::Rounding::nearest;
    e.sensor = options.sensor;
    e.series = orbits::simulate(*e.system, e.binding.base, options).series;
    free_parameter(e, "l", 0.317 * 1.2, 0.05);
    free_parameter(e, "k1", 2e-3, 0.0);
    free_parameter(e, "k2", 4.85e-4 * 2.0, 0.0);
    free_parameter(e, "k3", 1.9e-4 * 0.5, 0.0);
    return e;
}

Eigen::VectorXd start_of(const Experiment& e) {
    Eigen::VectorXd theta(e.binding.estimated_count);
    for (std::size_t i = 0; i < e.parameters.size(); ++i)
        theta[static_cast<Eigen::Index>(i)] = e.parameters[i].start;
    return theta;
}

void print_errors(const Experiment& e, const double* theta) {
    for (std::size_t i = 0; i < e.parameters.size(); ++i)
        std::printf("  %s %+.1e", e.parameters[i].name.c_str(), theta[i] / e.truth[static_cast<Eigen::Index>(i)] - 1.0);
    std::printf("\n");
}

// ---- Ceres

int threads() {
    return static_cast<int>(
        oneapi::tbb::global_control::active_value(oneapi::tbb::global_control::max_allowed_parallelism));
}

/// The series cut into intervals of so many samples, nodes from the readings.
/// @param most  samples of each segment that count
ShootingTask shooting_task(const Experiment& e, Eigen::Index interval, Eigen::Index most) {
    ShootingTask task;
    const bool reads_states = e.sensor.type == models::Sensor::Type::state;
    task.system = reads_states ? ShootingTask::System::lorenz : ShootingTask::System::pendulum;
    task.reading_sd = reads_states ? 0.5 : e.sensor.step / std::sqrt(12.0);
    const double period = reads_states ? 0.01 : turn / 9.09;
    const Eigen::VectorXd start = start_of(e);
    task.theta.assign(start.begin(), start.end());
    task.threads = threads();
    for (const orbits::Segment& segment : e.series.segments) {
        const Eigen::Index last = std::min(segment.values.cols(), most) - 1;
        for (Eigen::Index first = 0; first <= last; first += interval) {
            ShootingInterval piece;
            const Eigen::Index end = std::min(first + interval, last);
            piece.linked = first + interval <= last;
            const auto read = [&](double after, auto... values) {
                piece.durations.push_back(after);
                (piece.readings.push_back(values), ...);
            };
            for (Eigen::Index k = first; k <= end; ++k) {
                const double after = period * static_cast<double>(k - first);
                const bool next = piece.linked && k == end;  // of the next interval
                const double none = std::numeric_limits<double>::quiet_NaN();
                const auto y = segment.values.col(k);
                if (reads_states) {
                    next ? read(after, none, none, none) : read(after, y[0], y[1], y[2]);
                } else {
                    read(after, next ? none : y[0]);
                    if (!next) read(after + e.sensor.delay, y[0] + e.sensor.delay * y[1]);
                }
            }
            const auto y = segment.values.col(first);
            task.nodes.insert(task.nodes.end(), y.begin(), y.end());
            // The difference quotient is the mean over the delay: half of it back to the instant.
            if (!reads_states) {
                const Eigen::MatrixXd f = e.system->rhs(y, std::vector{0.0}, e.binding.values(start));
                task.nodes.back() -= 0.5 * e.sensor.delay * f(1, 0);
            }
            task.intervals.push_back(std::move(piece));
        }
    }
    return task;
}

void print_solution(const Experiment& e, const char* what, const ShootingSolution& solution) {
    std::printf("  %-44s %s, %3d iterations, %7.2f s, chi2/N of readings %.3g\n   ", what,
                solution.converged ? "converged" : "NOT converged", solution.iterations, solution.seconds,
                solution.readings_chi2);
    print_errors(e, solution.theta.data());
}

void single_shooting(const Experiment& e, const std::vector<Eigen::Index>& lengths) {
    for (const Eigen::Index length : lengths) {
        Experiment one = e;
        one.series.segments.resize(1);
        ShootingTask task = shooting_task(one, length, length + 1);
        task.intervals.resize(1);
        task.intervals[0].linked = false;
        task.nodes.resize(static_cast<std::size_t>(e.system->dimension()));
        task.iterations = 200;
        const std::string what = "single shooting over " + std::to_string(length) + " samples";
        print_solution(e, what.c_str(), solve_with_ceres(task));
    }
}

// ---- ours

struct Ours {
    std::unique_ptr<orbits::ShootingResidual> residual;
    estimator::Estimate estimate;
    Eigen::VectorXd theta;
    double seconds = 0.0;
};

Ours ours(const Experiment& e) {
    Ours result;
    const double begin = now();
    auto parameters = e.parameters;
    result.theta = start_of(e);
    const auto starts =
        orbits::transitions(*e.system, e.binding.values(result.theta), e.series, e.sensor, {}, 1, 2000, 1);
    Eigen::MatrixXd states(e.system->dimension(), std::ssize(starts));
    for (std::size_t k = 0; k < starts.size(); ++k)
        states.col(static_cast<Eigen::Index>(k)) = starts[k].from;
    orbits::PredictionOptions prediction;
    prediction.sizes = orbits::error_sizes(e.sensor, orbits::coordinate_range(*e.system, e.series, states));
    orbits::PredictionResidual first(e.system, e.binding, starts, orbits::transition_clock(*e.system, e.series),
                                     result.theta, prediction);
    estimator::EstimateOptions options;
    options.verdict = false;
    options.clusters = estimator::Clusters::none;
    options.step_tolerance = 1e-2;
    const auto use = [&](const estimator::Estimate& estimate) {
        for (std::size_t i = 0; i < parameters.size(); ++i)
            result.theta[static_cast<Eigen::Index>(i)] = parameters[i].start = estimate.parameters[i].value;
    };
    use(estimator::estimate(parameters, {&first}, {}, options));
    orbits::ShootingOptions shooting;
    shooting.sensor = e.sensor;
    shooting.start = result.theta;
    result.residual = std::make_unique<orbits::ShootingResidual>(e.system, e.binding, e.series, shooting);
    result.estimate = estimator::estimate(parameters, {result.residual.get()}, {}, options);
    use(result.estimate);
    result.seconds = now() - begin;
    return result;
}

void print_ours(const Experiment& e, const Ours& o) {
    std::printf("  %-44s %s, %3d iterations, %7.2f s, scale of readings %.3g of the true one\n   ", "ours",
                std::string(name(o.estimate.status)).c_str(), o.estimate.iterations, o.seconds,
                o.estimate.scales[0].value /
                    (e.sensor.type == models::Sensor::Type::state ? 0.5 : e.sensor.step / std::sqrt(12.0)));
    print_errors(e, o.theta.data());
    std::printf("    sd");
    for (std::size_t i = 0; i < e.parameters.size(); ++i)
        std::printf("  %s %.1e", e.parameters[i].name.c_str(),
                    o.estimate.parameters[i].sd / e.truth[static_cast<Eigen::Index>(i)]);
    std::printf("\n");
}

// ---- the paper's method

void paper_method(const Experiment& from, const std::vector<std::pair<std::string, double>>& starts) {
    Experiment e = from;
    e.binding.parameter.clear();
    e.binding.estimated.clear();
    e.binding.estimated_count = 0;
    e.parameters.clear();
    for (const auto& [name, start] : starts)
        free_parameter(e, name, start, 0.0);
    const double begin = now();
    orbits::CycleSearchOptions search;
    search.method = orbits::CycleSearchOptions::Method::closest_return;
    search.box = 0.01;
    search.minimum_recurrences = 3;
    const auto found = orbits::find_cycles(e.series, search);
    orbits::CycleResidualOptions options;
    options.targets.weights = orbits::CycleWeights::equal;
    options.targets.sensor = e.sensor;
    orbits::CycleResidual residual(e.system, e.binding, found.cycles, e.series.phase, start_of(e), {}, options);
    estimator::EstimateOptions estimation;
    estimation.verdict = false;
    const auto estimate = estimator::estimate(e.parameters, {&residual}, {}, estimation);
    std::printf("  the paper's method, %zu cycles, %s, %.2f s\n   ", found.cycles.size(),
                std::string(name(estimate.status)).c_str(), now() - begin);
    Eigen::VectorXd theta(std::ssize(e.parameters));
    for (std::size_t i = 0; i < e.parameters.size(); ++i)
        theta[static_cast<Eigen::Index>(i)] = estimate.parameters[i].value;
    print_errors(e, theta.data());
}

// ---- parts

void run_lorenz() {
    const Experiment e = lorenz();
    std::printf("Lorenz, %zu points; relative errors of the parameters\n", e.series.size());
    single_shooting(e, {100, 500, 1000, 2000, 3000});
    for (const int interval : {10, 20, 50, 100})
        for (const double matching : {1e-3, 1e-1}) {
            ShootingTask task = shooting_task(e, interval, 1 << 30);
            task.matching_sd.assign(3, matching);
            task.iterations = 200;
            char what[80];
            std::snprintf(what, sizeof what, "Ceres, intervals of %.1f s, matching sd %g", 0.01 * interval, matching);
            print_solution(e, what, solve_with_ceres(task));
        }
    print_ours(e, ours(e));
}

void run_pendulum(std::size_t sections) {
    const Experiment e = pendulum(sections);
    std::printf("pendulum, %zu sections in %zu transients; relative errors of the parameters\n", e.series.size(),
                e.series.segments.size());
    single_shooting(e, {2, 5, 10, 20, 50});
    // One weight for all, and a ladder that a user who knows the trouble may climb.
    ShootingTask task = shooting_task(e, 1, 1 << 30);
    task.iterations = 100;
    for (const double matching : {1e-2, 1e-4, 1e-6}) {
        task.matching_sd = {matching, 5.0 * matching};
        char what[80];
        std::snprintf(what, sizeof what, "Ceres, matching sd %g rad", matching);
        print_solution(e, what, solve_with_ceres(task));
    }
    ShootingSolution solution;
    double seconds = 0.0;
    int iterations = 0;
    for (const double matching : {1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6}) {
        task.matching_sd = {matching, 5.0 * matching};
        solution = solve_with_ceres(task);
        task.theta = solution.theta;
        task.nodes = solution.nodes;
        seconds += solution.seconds;
        iterations += solution.iterations;
    }
    solution.seconds = seconds;
    solution.iterations = iterations;
    print_solution(e, "Ceres, matching sd from 0.1 to 1e-6 rad", solution);
    paper_method(e, {{"m", 0.0858 * 1.51}, {"l", 0.317 * 1.189}});
    paper_method(e, {{"l", 0.317 * 1.189}, {"k2", 4.85e-4 * 2.0}, {"k3", 1.9e-4 * 0.5}});
    print_ours(e, ours(e));
}

/// Time of an iteration: a step that is accepted, with one evaluation with derivatives, one without and the linear
/// algebra, for both on all threads.
void run_iteration(std::size_t sections) {
    const Experiment e = pendulum(sections);
    std::printf("one iteration on %zu sections, %d threads\n", e.series.size(), threads());
    ShootingTask task = shooting_task(e, 1, 1 << 30);
    task.theta.assign(e.truth.begin(), e.truth.end());
    for (double& p : task.theta)
        p *= 1.01;
    task.matching_sd = {1e-3, 5e-3};
    task.iterations = 4;
    orbits::ShootingOptions shooting;
    shooting.sensor = e.sensor;
    shooting.start = 1.01 * e.truth;
    auto parameters = e.parameters;
    for (std::size_t i = 0; i < parameters.size(); ++i)
        parameters[i].start = 1.01 * e.truth[static_cast<Eigen::Index>(i)];
    for (const double tolerance : {1e-9, 1e-11}) {
        task.tolerance = tolerance;
        const ShootingSolution peer = solve_with_ceres(task);
        const double peer_seconds = peer.iterating / peer.iterations;
        std::printf("  tolerance %.0e: Ceres %.3f s per iteration (derivatives %.3f s, linear solver %.3f s)\n",
                    tolerance, peer_seconds, peer.derivatives / (peer.iterations + 1), peer.linear / peer.iterations);
        shooting.flow = {tolerance, tolerance, 100000};
        orbits::ShootingResidual residual(e.system, e.binding, e.series, shooting);
        const auto latents = residual.initial_latents();
        double best[2] = {1e300, 1e300};
        for (int round = 0; round < 3; ++round)
            for (const bool derivatives : {false, true}) {
                const double begin = now();
                const auto values = residual.evaluate(shooting.start, latents, derivatives);
                best[derivatives ? 1 : 0] = std::min(best[derivatives ? 1 : 0], now() - begin);
            }
        // A few steps, between the first and the last of which an iteration takes its time.
        std::vector<double> times;
        estimator::EstimateOptions options;
        options.verdict = false;
        options.clusters = estimator::Clusters::none;
        options.step_tolerance = 1e-2;
        options.maximum_iterations = 6;
        options.progress = [&](int, double) { times.push_back(now()); };
        (void)estimator::estimate(parameters, {&residual}, {}, options);
        double shortest = 1e300;
        for (std::size_t i = 1; i < times.size(); ++i)
            shortest = std::min(shortest, times[i] - times[i - 1]);
        std::printf("    ours: evaluation %.3f s, with derivatives %.3f s; a step of the estimator %.3f s\n", best[0],
                    best[1], shortest);
        std::printf("    Ceres over ours: evaluation with derivatives %.1f, iteration %.1f\n",
                    peer.derivatives / (peer.iterations + 1) / best[1], peer_seconds / shortest);
    }
    // One flow on one thread, and what it is worth: errors against a tolerance of 1e-14.
    task.intervals.resize(std::min<std::size_t>(task.intervals.size(), 2000));
    task.tolerance = 1e-10;
    std::vector<double> ends;
    const double peer = microseconds_of_odeint(task, ends);
    std::printf("  Odeint's flow with sensitivities at 1e-10: %.1f us\n", peer);
}

}  // namespace

}  // namespace orbid::bench

int main(int argc, char** argv) {
    using namespace orbid::bench;
    std::size_t pendulum_sections = 5000, iteration_sections = 42754;
    std::set<std::string> parts;
    for (int i = 1; i < argc; ++i) {
        const std::string part = argv[i];
        parts.insert(part);
        if (part != "lorenz" && i + 1 < argc && std::atol(argv[i + 1]) > 0)
            (part == "pendulum" ? pendulum_sections : iteration_sections) =
                static_cast<std::size_t>(std::atol(argv[++i]));
    }
    if (parts.empty()) parts = {"lorenz", "pendulum", "iteration"};
    if (parts.contains("lorenz")) run_lorenz();
    if (parts.contains("pendulum")) run_pendulum(pendulum_sections);
    if (parts.contains("iteration")) run_iteration(iteration_sections);
    return 0;
}
