// How far off a start may be: estimates of the pendulum's length and frictions from the cycles of one series, started
// at random: l log-uniform in [0.5, 2] times the truth, k2 and k3 log-uniform in [0.01, 10] times it or, each with a
// probability of 10 %, at 0.
//   start_region_bench cycles.json [starts, default 200] [way, default plain] [error, default 0] [first, default 0]
// way: plain (the automatic way without the scan), scan (with it), or for comparison, after the one-period prediction:
// constraints (matching exact, in the estimator's own stages), tails (Student's t throughout).
// cycles.json: of configs/pendulum_table3.json ("orbid orbits"). error > 0: the model's own orbits with white errors of
// this share of the range instead of the measured points.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <string>

#include <fmt/format.h>

#include "bench/measured_orbits.hpp"
#include "identification/starts/cycle_start.hpp"
#include "orbits/cycle_residuals/lifted_cycle_residual.hpp"
#include "orbits/cycle_residuals/one_period_residual.hpp"

using namespace orbid;

namespace {

struct Run {
    estimator::Estimate estimate;
    Eigen::VectorXd theta;
    bool finished = false;
};

identification::CycleStart by_one_estimate(const bench::MeasuredOrbits& measured,
                                           const std::vector<orbits::Cycle>& cycles,
                                           std::vector<estimator::FreeParameter> parameters, bool constraints) {
    for (estimator::FreeParameter& parameter : parameters)
        parameter.scale = estimator::Scale::linear;
    identification::CycleStart result;
    result.theta.resize(static_cast<Eigen::Index>(parameters.size()));
    const auto move = [&](const estimator::Estimate& estimate) {
        for (std::size_t i = 0; i < parameters.size(); ++i) {
            if (estimate.status != estimator::EstimateStatus::failed)
                parameters[i].start = estimate.parameters[i].value;
            result.theta(static_cast<Eigen::Index>(i)) = std::max(parameters[i].start, 1e-9);
        }
    };
    estimator::EstimateOptions rough;
    rough.variance = estimator::Variance::ml;
    rough.step_tolerance = 1e-2;
    rough.verdict = false;
    move({});
    orbits::OnePeriodResidual prediction(measured.system, measured.binding, cycles, 0.0, result.theta);
    move(estimator::estimate(parameters, {&prediction}, {}, rough));
    orbits::LiftedCycleOptions options;
    options.exact = constraints;
    if (!constraints) {
        options.matching = options.points = estimator::StudentErrors{};
        options.matching_start = 0.16;
        options.matching_factor = 0.3;
    }
    orbits::LiftedCycleResidual lifted(measured.system, measured.binding, cycles, 0.0, result.theta, options);
    const auto estimate = estimator::estimate(parameters, {&lifted}, {}, rough);
    move(estimate);
    result.nodes = estimate.latents.empty() ? lifted.nodes(lifted.initial_set(), lifted.initial_latents())
                                            : lifted.nodes(estimate.active.front(), estimate.latents.front());
    return result;
}

Run from(const bench::MeasuredOrbits& measured, const std::vector<orbits::Cycle>& cycles, const Eigen::VectorXd& start,
         const std::string& way, bool verbose) {
    auto parameters = measured.parameters;
    for (std::size_t i = 0; i < parameters.size(); ++i) {
        parameters[i].start = start(static_cast<Eigen::Index>(i));
        if (!(parameters[i].start > 0.0)) parameters[i].scale = estimator::Scale::linear;
    }
    identification::CycleStartOptions options;
    options.estimate.step_tolerance = 1e-3;
    options.scan = way == "scan";
    if (verbose) options.log = [](const std::string& line) { fmt::print("    {}\n", line); };
    const identification::CycleStart found =
        way == "constraints" || way == "tails"
            ? by_one_estimate(measured, cycles, parameters, way == "constraints")
            : identification::start_from_cycles({measured.system, measured.binding, cycles, 0.0, {}}, parameters,
                                                options);
    for (std::size_t i = 0; i < parameters.size(); ++i)
        parameters[i].start = found.theta(static_cast<Eigen::Index>(i));
    orbits::CycleResidual residual(measured.system, measured.binding, cycles, 0.0, found.theta, found.nodes);
    Run run;
    run.estimate = estimator::estimate(parameters, {&residual}, {}, options.estimate);
    run.theta.resize(start.size());
    for (std::size_t i = 0; i < run.estimate.parameters.size(); ++i)
        run.theta(static_cast<Eigen::Index>(i)) = run.estimate.parameters[i].value;
    run.finished = run.estimate.parameters.size() == parameters.size() &&
                   run.estimate.status == estimator::EstimateStatus::converged;
    return run;
}

}  // namespace

int main(int count, char** arguments) {
    if (count < 2) {
        fmt::print(stderr, "needs cycles.json of configs/pendulum_table3.json\n");
        return 2;
    }
    const int starts = count > 2 ? std::atoi(arguments[2]) : 200;
    const std::string way = count > 3 ? arguments[3] : "plain";
    const double error = count > 4 ? std::atof(arguments[4]) : 0.0;
    const int first = count > 5 ? std::atoi(arguments[5]) : 0;
    const auto measured =
        bench::measured_orbits(ORBID_SOURCE_DIR "/configs/pendulum_table3.json", arguments[1], {"l", "k2", "k3"});
    const std::vector<orbits::Cycle> cycles = error > 0.0 ? measured.noisy(error, 1.0, 1) : measured.cycles;
    const Eigen::VectorXd truth = measured.truth();
    const Run optimum = from(measured, cycles, truth, "plain", false);
    if (!optimum.finished) {
        fmt::print("no estimate from the true parameters: {}\n", optimum.estimate.message);
        return 1;
    }
    fmt::print("optimum: {} cycles, relative sds", optimum.estimate.counts[0].used);
    for (const auto& parameter : optimum.estimate.parameters)
        fmt::print("  {} {:.1e}", parameter.name, parameter.sd / parameter.value);
    fmt::print("\n");

    bench::Numbers numbers(7);
    int reached = 0, tried = 0;
    const auto begin = std::chrono::steady_clock::now();
    for (int k = 0; k < first + starts; ++k) {
        Eigen::VectorXd factor(3);
        factor(0) = std::exp(std::log(2.0) * (2.0 * numbers.uniform() - 1.0));
        for (Eigen::Index i = 1; i < 3; ++i) {
            const double size = 0.01 * std::pow(1000.0, numbers.uniform());
            factor(i) = numbers.uniform() < 0.1 ? 0.0 : size;
        }
        if (k < first) continue;
        const Run run = from(measured, cycles, factor.cwiseProduct(truth), way, starts == 1);
        ++tried;
        // The same optimum: nearer than a tenth of its sds (gates may settle a cycle apart).
        double distance = 0.0;
        for (Eigen::Index i = 0; i < 3; ++i)
            distance = std::max(distance, std::abs(run.theta(i) - optimum.theta(i)) /
                                              optimum.estimate.parameters[static_cast<std::size_t>(i)].sd);
        const bool hit = run.finished && distance < 0.1;
        reached += hit ? 1 : 0;
        if (!hit)
            fmt::print("start {}: factors {:.3f} {:.3f} {:.3f} end at {:.4f} {:.4f} {:.4f}, {:.1e} sds off, {}: {}\n",
                       k, factor(0), factor(1), factor(2), run.theta(0) / truth(0), run.theta(1) / truth(1),
                       run.theta(2) / truth(2), distance, estimator::name(run.estimate.status), run.estimate.message);
        std::fflush(stdout);
    }
    const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    fmt::print("{} of {} starts reach the optimum, {:.2f} s each\n", reached, tried, seconds / tried);
    return 0;
}
