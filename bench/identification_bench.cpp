// Identification from recorded series, ours against what else there is, in one run:
//   - single shooting (Ceres, one initial state per segment): how far it goes;
//   - multiple shooting with Ceres and Boost.Odeint, as a user writes it;
//   - the paper's method: cycles by closest returns, equal weights, re-solved orbits;
//   - ours: prediction over one interval, then the series residual.
//
//   identification_bench [lorenz] [short] [pendulum [SECTIONS]] [paper [SECTIONS]] [iteration [SECTIONS]]
//   default: all, with 5000 sections, 42754 and 42754
//   identification_bench long [SECTIONS]: ours alone, on 1000000 sections; takes minutes and 4 GB
//
// Experiments: Lorenz' equations, 30 s every 0.01 s, all states read with noise 0.5, from (1, 2.2, 0.2) (true 10, 28,
// 2.66); the parametric pendulum with dry friction, sections read by an encoder of 4096 steps, now and 15.08 ms later,
// l, k1, k2, k3 unknown.

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <limits>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "bench/identification_experiment.hpp"
#include "bench/ratio.hpp"
#include "orbits/cycle_residuals/cycle_residual.hpp"
#include "orbits/cycles/cycle_search.hpp"
#include "orbits/series_residuals/prediction_residual.hpp"
#include "orbits/series_residuals/shooting_residual.hpp"
#include "orbits/simulation/node_state.hpp"

namespace orbid::bench {

namespace {

double now() {
    return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

void print_errors(const Experiment& e, const double* theta) {
    for (std::size_t i = 0; i < e.parameters.size(); ++i)
        std::printf("  %s %+.1e", e.parameters[i].name.c_str(), theta[i] / e.truth[static_cast<Eigen::Index>(i)] - 1.0);
    std::printf("\n");
}

void print_solution(const Experiment& e, const char* what, const ShootingSolution& solution) {
    std::printf("  %-44s %s, %3d iterations, %7.2f s, chi2/N of readings %.3g\n   ", what,
                solution.converged ? "converged" : "NOT converged", solution.iterations, solution.seconds,
                solution.readings_chi2);
    print_errors(e, solution.theta.data());
}

/// Matching made tighter from stage to stage, as a user may who knows the trouble. @param weights  of the coordinates.
double ladder(const Experiment& e, ShootingTask task, const std::vector<double>& matching,
              const std::vector<double>& weights) {
    ShootingSolution solution;
    double seconds = 0.0;
    int iterations = 0;
    for (const double sd : matching) {
        task.matching_sd = weights;
        for (double& one : task.matching_sd)
            one *= sd;
        solution = solve_with_ceres(task);
        task.theta = solution.theta;
        task.nodes = solution.nodes;
        seconds += solution.seconds;
        iterations += solution.iterations;
    }
    solution.seconds = seconds;
    solution.iterations = iterations;
    char what[80];
    std::snprintf(what, sizeof what, "Ceres, matching sd from %g to %g", matching.front(), matching.back());
    print_solution(e, what, solution);
    return seconds;
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

/// The series as one course from its first state.
Ours in_one_course(const Experiment& e) {
    Ours result;
    const double begin = now();
    orbits::ShootingOptions shooting;
    shooting.sensor = e.sensor;
    shooting.start = start_of(e);
    shooting.interval = e.series.segments.front().values.cols();
    shooting.errors.assign(e.system->coordinates().size(), {false, 1.0});
    result.residual = std::make_unique<orbits::ShootingResidual>(e.system, e.binding, e.series, shooting);
    estimator::EstimateOptions options;
    options.verdict = false;
    result.estimate = estimator::estimate(e.parameters, {result.residual.get()}, {}, options);
    result.theta.resize(std::ssize(e.parameters));
    for (std::size_t i = 0; i < e.parameters.size(); ++i)
        result.theta[static_cast<Eigen::Index>(i)] = result.estimate.parameters[i].value;
    result.seconds = now() - begin;
    return result;
}

Ours ours(const Experiment& e) {
    Ours result;
    const double begin = now();
    auto parameters = e.parameters;
    result.theta = start_of(e);
    const auto starts =
        orbits::transitions(*e.system, e.binding.values(result.theta), e.series, e.sensor, {}, 1, 500, 1);
    Eigen::MatrixXd states(e.system->dimension(), std::ssize(starts));
    for (std::size_t k = 0; k < starts.size(); ++k)
        states.col(static_cast<Eigen::Index>(k)) = starts[k].from;
    orbits::PredictionOptions prediction;
    prediction.sizes = orbits::error_sizes(e.sensor, orbits::coordinate_range(*e.system, e.series, states));
    orbits::PredictionResidual first({e.system}, e.binding, starts, orbits::transition_clock(*e.system, e.series),
                                     result.theta, prediction);
    estimator::EstimateOptions options;
    options.verdict = false;
    options.clusters = estimator::Clusters::none;
    options.step_tolerance = 1e-2;
    options.error_uncertainties = false;
    const auto use = [&](const estimator::Estimate& estimate) {
        for (std::size_t i = 0; i < parameters.size(); ++i)
            result.theta[static_cast<Eigen::Index>(i)] = parameters[i].start = estimate.parameters[i].value;
    };
    use(estimator::estimate(parameters, {&first}, {}, options));
    orbits::ShootingOptions shooting;
    shooting.sensor = e.sensor;
    shooting.start = result.theta;
    options.error_uncertainties = true;
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
    const orbits::CycleResidual residual(e.system, e.binding, found.cycles, e.series.phase, start_of(e), {}, options);
    // The estimator leaves out orbits that are not found at the start until update_active_set() finds them.
    const auto values = residual.evaluate(residual.initial_set(), start_of(e), residual.initial_latents(), false);
    const auto lost = std::count_if(values.begin(), values.end(), [](const estimator::BlockValue& value) {
        return value.status != estimator::BlockStatus::ok;
    });
    estimator::EstimateOptions estimation;
    estimation.verdict = false;
    const auto estimate = estimator::estimate(e.parameters, {&residual}, {}, estimation);
    std::printf("  the paper's method, %zu cycles (%td lost at the start), %s (%s), %.2f s\n   ", found.cycles.size(),
                lost, std::string(name(estimate.status)).c_str(), estimate.message.c_str(), now() - begin);
    Eigen::VectorXd theta(std::ssize(e.parameters));
    for (std::size_t i = 0; i < e.parameters.size(); ++i)
        theta[static_cast<Eigen::Index>(i)] = estimate.parameters[i].value;
    print_errors(e, theta.data());
}

// ---- parts

void run_lorenz() {
    const Experiment e = lorenz_experiment();
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
    // The optimum of a deterministic model, with segments picked by hand.
    double peer = std::numeric_limits<double>::infinity();
    // The shortest of some runs each: they take a tenth of a second.
    constexpr int runs = 3;
    for (const int interval : {20, 50}) {
        ShootingTask task = shooting_task(e, interval, 1 << 30);
        task.iterations = 200;
        for (int i = 0; i < runs; ++i)
            peer = std::min(peer, ladder(e, task, {1e-1, 1e-2, 1e-3}, {1.0, 1.0, 1.0}));
    }
    Ours own = ours(e);
    for (int i = 1; i < runs; ++i)
        if (Ours run = ours(e); run.seconds < own.seconds) own = std::move(run);
    print_ours(e, own);
    print_ratio("Lorenz, 30 s from bad starts, errors unknown", "Ceres, stages and intervals by hand, errors known",
                own.seconds, peer, "s");
}

/// The shortest of some runs each: they take milliseconds.
void run_short_lorenz() {
    const Experiment e = short_lorenz_experiment();
    std::printf("Lorenz, %zu exact points; relative errors of the parameters\n", e.series.size());
    constexpr int runs = 20;
    ShootingTask task = shooting_task(e, e.series.segments.front().values.cols(), 1 << 30);
    ShootingSolution theirs;
    Ours own;
    theirs.seconds = own.seconds = std::numeric_limits<double>::infinity();
    for (int i = 0; i < runs; ++i) {
        ShootingSolution solution = solve_with_ceres(task);
        if (solution.seconds < theirs.seconds) theirs = std::move(solution);
        Ours run = in_one_course(e);
        if (run.seconds < own.seconds) own = std::move(run);
    }
    print_solution(e, "Ceres, one course", theirs);
    print_ours(e, own);
    print_ratio("Lorenz, 3 s, exact (SciML's case)", "Ceres", 1e3 * own.seconds, 1e3 * theirs.seconds, "ms");
}

void run_pendulum(std::size_t sections) {
    const Experiment e = pendulum_experiment(sections);
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
    const double peer = ladder(e, task, {1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6}, {1.0, 5.0});
    const Ours own = ours(e);
    print_ours(e, own);
    print_ratio("pendulum, " + std::to_string(e.series.size()) + " sections from bad starts, errors unknown",
                "Ceres, stages by hand, errors known", own.seconds, peer, "s");
}

/// Time and memory are linear in the number of sections.
void run_long(std::size_t sections) {
    const Experiment e = pendulum_experiment(sections);
    std::printf("pendulum, %zu sections in %zu transients; relative errors of the parameters\n", e.series.size(),
                e.series.segments.size());
    print_ours(e, ours(e));
}

/// From the paper's starts: Tables IV and V, then what it could not separate.
void run_paper(std::size_t sections) {
    const Experiment e = pendulum_experiment(sections);
    std::printf("pendulum, %zu sections; relative errors of the parameters\n", e.series.size());
    paper_method(e, {{"m", 0.0858 * 1.51}, {"l", 0.317 * 1.189}});
    paper_method(e, {{"k3", 0.0}});
    paper_method(e, {{"l", 0.317 * 1.1}, {"k1", 2e-3}, {"k2", 4.85e-4 * 2.0}, {"k3", 1.9e-4 * 0.5}});
}

}  // namespace

}  // namespace orbid::bench

int main(int argc, char** argv) {
    using namespace orbid::bench;
    std::setvbuf(stdout, nullptr, _IOLBF, 1024);  // it takes its time
    std::map<std::string, std::size_t> parts;
    const std::map<std::string, std::size_t> all{
        {"lorenz", 3001}, {"short", 301}, {"pendulum", 5000}, {"paper", 42754}, {"iteration", 42754}};
    std::map<std::string, std::size_t> known = all;
    known["long"] = 1000000;
    for (int i = 1; i < argc; ++i) {
        const auto part = known.find(argv[i]);
        if (part == known.end()) {
            std::printf("no part is called %s\n", argv[i]);
            return 2;
        }
        parts.insert(*part);
        if (i + 1 < argc && std::atol(argv[i + 1]) > 0)
            parts[part->first] = static_cast<std::size_t>(std::atol(argv[++i]));
    }
    if (parts.empty()) parts = all;
    if (parts.contains("lorenz")) run_lorenz();
    if (parts.contains("short")) run_short_lorenz();
    if (parts.contains("pendulum")) run_pendulum(parts["pendulum"]);
    if (parts.contains("long")) run_long(parts["long"]);
    if (parts.contains("paper")) run_paper(parts["paper"]);
    if (parts.contains("iteration")) compare_iterations(parts["iteration"]);
    return 0;
}
