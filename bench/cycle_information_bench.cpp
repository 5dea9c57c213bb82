// What measured cycles tell about the pendulum's parameters, and whether estimates reach it: the inverse of the
// information at the true parameters beside the scatter of estimates from the model's own orbits with simulated errors.
//   cycle_information_bench cycles.json orbits [replicates, default 100] [error, default 5e-3]
//       cycles of periods up to 1, 2, .. 5 with at least three recurrences, positions alone; free: l; m; k2 and k3
//   cycle_information_bench cycles.json multipliers [replicates, default 100] [e d, default five pairs]
//       all cycles, free as in Tables I-III: positions with errors e (share of the range), ln|multiplier| with errors
//       d, alone and together (0 replicates: the information only)
//   cycle_information_bench cycles.json measured
//       estimates from the cycles as measured, the same three ways
// cycles.json: of configs/pendulum_table3.json ("orbid orbits").
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <numeric>
#include <string>

#include <fmt/format.h>
#include <Eigen/Cholesky>
#include <Eigen/LU>

#include "bench/measured_orbits.hpp"

using namespace orbid;
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

const std::string job = ORBID_SOURCE_DIR "/configs/pendulum_table3.json";

/// What Tables I-III estimate.
const std::vector<std::vector<std::string>> tables{{"m", "l"}, {"k2", "k3"}, {"l", "k2", "k3"}};

struct Errors {
    double position = 0.0;  ///< of the range; 0: withheld
    double multiplier = 0.0;
    std::vector<int> periods = {};
};

struct Study {
    VectorXd bound;            ///< relative sds from the information at the truth
    VectorXd scatter;          ///< root mean square relative errors of the estimates
    VectorXd reported;         ///< mean of the sds they report, relative
    VectorXd covered;          ///< share of 95 % intervals that hold the truth
    double correlation = 0.0;  ///< of the last two parameters, from the information
    int converged = 0;
    Index values = 0;
};

orbits::CycleResidualOptions residual_options(const Errors& errors) {
    orbits::CycleResidualOptions options;
    options.targets.positions = errors.position > 0.0;
    options.targets.multipliers = errors.multiplier > 0.0;
    options.targets.periods = errors.periods;
    return options;
}

Study study(const bench::MeasuredOrbits& measured, const Errors& errors, int replicates) {
    const VectorXd truth = measured.truth();
    const auto q = truth.size();
    const double e = errors.position > 0.0 ? errors.position : 1e-3;
    const double d = errors.multiplier > 0.0 ? errors.multiplier : 1.0;
    Study result;
    MatrixXd information = MatrixXd::Zero(q, q);
    {
        const auto cycles = measured.noisy(e, d, 0);
        const orbits::CycleResidual residual(measured.system, measured.binding, cycles, 0.0, truth, {},
                                             residual_options(errors));
        const auto values = residual.evaluate(residual.initial_set(), truth, {}, true);
        for (std::size_t b = 0; b < values.size(); ++b) {
            if (!residual.layout()[b].active || values[b].status != estimator::BlockStatus::ok) continue;
            const MatrixXd root =
                residual.layout()[b].shape.llt().matrixL().solve(values[b].e_theta * truth.asDiagonal());
            information += root.transpose() * root;
            result.values += root.rows();
        }
    }
    const MatrixXd covariance = information.inverse();
    result.bound = covariance.diagonal().cwiseSqrt();
    if (q > 1) result.correlation = covariance(q - 2, q - 1) / (result.bound(q - 2) * result.bound(q - 1));
    result.scatter = result.reported = result.covered = VectorXd::Zero(q);
    for (int k = 1; k <= replicates; ++k) {
        const auto cycles = measured.noisy(e, d, static_cast<std::uint64_t>(k) * 1000003U);
        auto parameters = measured.parameters;
        for (std::size_t i = 0; i < parameters.size(); ++i)
            parameters[i].start = truth(static_cast<Index>(i));
        orbits::CycleResidual residual(measured.system, measured.binding, cycles, 0.0, truth, {},
                                       residual_options(errors));
        estimator::EstimateOptions options;
        options.step_tolerance = 1e-3;
        options.verdict = false;
        const auto estimate = estimator::estimate(parameters, {&residual}, {}, options);
        if (estimate.status != estimator::EstimateStatus::converged) continue;
        ++result.converged;
        for (Index i = 0; i < q; ++i) {
            const auto& parameter = estimate.parameters[static_cast<std::size_t>(i)];
            result.scatter(i) += std::pow(parameter.value / truth(i) - 1.0, 2);
            result.reported(i) += parameter.sd / truth(i);
            if (parameter.lower95 <= truth(i) && truth(i) <= parameter.upper95) result.covered(i) += 1.0;
        }
    }
    const double n = std::max(result.converged, 1);
    result.scatter = (result.scatter / n).cwiseSqrt();
    result.reported /= n;
    result.covered /= n;
    return result;
}

void print(const bench::MeasuredOrbits& measured, const std::string& what, const Study& found, int replicates) {
    if (replicates == 0) {
        fmt::print("{:<34} {:>5} values", what, found.values);
        for (Index i = 0; i < found.bound.size(); ++i)
            fmt::print(" | {} bound {:.3g} %", measured.parameters[static_cast<std::size_t>(i)].name,
                       100.0 * found.bound(i));
        fmt::print("\n");
        return;
    }
    fmt::print("{:<34} {:>5} values, {}/{} converged", what, found.values, found.converged, replicates);
    for (Index i = 0; i < found.bound.size(); ++i)
        fmt::print(" | {} bound {:.3g} % scatter / bound {:.2f} sd / bound {:.2f} covered {:.0f} %",
                   measured.parameters[static_cast<std::size_t>(i)].name, 100.0 * found.bound(i),
                   found.scatter(i) / found.bound(i), found.reported(i) / found.bound(i), 100.0 * found.covered(i));
    if (found.bound.size() > 1) fmt::print(" | corr {:.3f}", found.correlation);
    fmt::print("\n");
    std::fflush(stdout);
}

void orbit_sets(const std::string& file, int replicates, double error) {
    const std::vector<std::vector<std::string>> sets{{"l"}, {"m"}, {"k2", "k3"}};
    for (const auto& free : sets) {
        auto measured = bench::measured_orbits(job, file, free);
        std::erase_if(measured.exact, [](const orbits::Cycle& cycle) { return cycle.recurrences < 3; });
        Errors errors{error, 0.0, {}};
        for (int period = 1; period <= 5; ++period) {
            errors.periods.push_back(period);
            print(measured, fmt::format("periods up to {}", period), study(measured, errors, replicates), replicates);
        }
    }
}

void multipliers(const std::string& file, int replicates, const std::vector<std::pair<double, double>>& errors) {
    for (const auto& free : tables) {
        const auto measured = bench::measured_orbits(job, file, free);
        for (const auto& [e, d] : errors) {
            const Study alone = study(measured, {e, 0.0, {}}, replicates);
            const Study both = study(measured, {e, d, {}}, replicates);
            print(measured, fmt::format("e {:.0e}", e), alone, replicates);
            print(measured, fmt::format("e {:.0e}, d {:.0e}", e, d), both, replicates);
            fmt::print("    gain by the information, of the scatter:");
            for (Index i = 0; i < both.bound.size(); ++i)
                fmt::print("  {} {:.2f} {:.2f}", measured.parameters[static_cast<std::size_t>(i)].name,
                           alone.bound(i) / both.bound(i), alone.scatter(i) / both.scatter(i));
            fmt::print("\n");
        }
        print(measured, "multipliers alone, d 5e-4", study(measured, {0.0, 5e-4, {}}, replicates), replicates);
    }
}

/// Estimates from the cycles as they were measured, with positions alone, both, and multipliers alone.
void as_measured(const std::string& file) {
    for (const auto& free : tables) {
        const auto measured = bench::measured_orbits(job, file, free);
        const VectorXd truth = measured.truth();
        for (const auto& [positions, multipliers] : {std::pair{true, false}, {true, true}, {false, true}}) {
            orbits::CycleResidualOptions options;
            options.targets.positions = positions;
            options.targets.multipliers = multipliers;
            orbits::CycleResidual residual(measured.system, measured.binding, measured.cycles, 0.0, truth, {}, options);
            estimator::EstimateOptions estimation;
            estimation.step_tolerance = 1e-3;
            const auto estimate = estimator::estimate(measured.parameters, {&residual}, {}, estimation);
            fmt::print("{}{}: {}, {} cycles, {} rejected", positions ? "positions " : "",
                       multipliers ? "multipliers" : "", estimator::name(estimate.status), estimate.counts[0].used,
                       estimate.counts[0].rejected);
            for (std::size_t i = 0; i < estimate.parameters.size(); ++i) {
                const auto& parameter = estimate.parameters[i];
                const double true_value = truth(static_cast<Index>(i));
                fmt::print(" | {} off {:.2e} sd {:.2e} z {:.2f}", parameter.name, parameter.value / true_value - 1.0,
                           parameter.sd / true_value, (parameter.value - true_value) / parameter.sd);
            }
            for (const auto& scale : estimate.scales)
                fmt::print(" | {} {:.2f} +- {:.2f}", scale.group, scale.value, scale.uncertainty);
            fmt::print("\n");
        }
    }
}

}  // namespace

int main(int count, char** arguments) {
    const std::string mode = count > 2 ? arguments[2] : "";
    const int replicates = count > 3 ? std::atoi(arguments[3]) : 100;
    if (mode == "orbits") {
        orbit_sets(arguments[1], replicates, count > 4 ? std::atof(arguments[4]) : 5e-3);
    } else if (mode == "multipliers") {
        std::vector<std::pair<double, double>> errors{
            {1e-6, 1e-3}, {1e-4, 1e-3}, {1e-3, 1e-3}, {1e-3, 1e-2}, {5e-3, 0.1}};
        if (count > 5) errors = {{std::atof(arguments[4]), std::atof(arguments[5])}};
        multipliers(arguments[1], replicates, errors);
    } else if (mode == "measured") {
        as_measured(arguments[1]);
    } else {
        fmt::print(stderr, "needs cycles.json and what to study: orbits, multipliers or measured\n");
        return 2;
    }
    return 0;
}
