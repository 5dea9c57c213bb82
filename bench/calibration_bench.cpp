// How good are estimates from recorded series, and how right are their intervals?
//
//   calibration_bench pendulum SECTIONS NOISE REPLICATES [FIRST_SEED]   virtual experiments and coverage
//   calibration_bench lorenz DURATION REPLICATES                        all states read with noise 0.5
//   calibration_bench length                                            cost against the number of sections
//
// NOISE: of a reading, as a share of the range (angle and velocity, state sensor); 0: the encoder's rounding alone.

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <numbers>
#include <string>
#include <vector>

#include "estimator/estimate/estimate.hpp"
#include "estimator/interface/random_stream.hpp"
#include "models/catalogue/registry.hpp"
#include "orbits/series_residuals/prediction_residual.hpp"
#include "orbits/series_residuals/shooting_residual.hpp"
#include "orbits/simulation/virtual_experiment.hpp"

using namespace orbid;

namespace {

double now() {
    using clock = std::chrono::steady_clock;
    return std::chrono::duration<double>(clock::now().time_since_epoch()).count();
}

/// A recorded series and what made it.
struct Experiment {
    std::shared_ptr<const models::System> system;
    models::ParameterBinding binding;
    std::vector<estimator::FreeParameter> parameters;
    Eigen::VectorXd truth;  // of the estimated parameters
    orbits::Series series;
    models::Sensor sensor;
    std::vector<double> errors;           // true sds of the readings, per group; empty: of a rounding instrument
    std::vector<Eigen::MatrixXd> states;  // true ones per segment
};

void free_parameter(Experiment& e, const std::string& name, double start, estimator::Scale scale, double lower) {
    const Eigen::Index index = e.system->parameter_index(name);
    estimator::FreeParameter p;
    p.name = name;
    p.start = start;
    p.scale = scale;
    p.lower = lower;
    p.typical_size = e.system->parameters()[static_cast<std::size_t>(index)].typical_size;
    e.binding.parameter.push_back(index);
    e.binding.estimated.push_back(e.binding.estimated_count++);
    e.parameters.push_back(p);
    e.truth.conservativeResize(e.binding.estimated_count);
    e.truth[e.binding.estimated_count - 1] = e.binding.base[index];
}

Experiment pendulum(std::size_t sections, double noise, std::uint64_t seed) {
    Experiment e;
    e.system = models::make_system("parametric_pendulum");
    e.binding.base = e.system->default_parameters();
    e.binding.base[e.system->parameter_index("k1")] = 1e-3;
    orbits::VirtualExperimentOptions options;
    options.plan = orbits::SectionPlan{sections, 20, {}, 0.0};
    options.seed = seed;
    options.flow = {1e-11, 1e-11, 100000};
    if (noise > 0.0) {
        options.noise = Eigen::Vector2d(noise * 2.0 * std::numbers::pi, noise * 29.3);
    } else {
        options.sensor.type = models::Sensor::Type::angle_difference;
        options.sensor.delay = 0.01508;
        options.sensor.step = 2.0 * std::numbers::pi / 4096.0;
        options.sensor.rounding = models::Sensor::Rounding::nearest;
    }
    e.sensor = options.sensor;
    const auto made = orbits::simulate(*e.system, e.binding.base, options);
    if (!made.complete) std::printf("# %s\n", made.message.c_str());
    e.series = made.series;
    if (noise > 0.0) e.errors = {options.noise[0], options.noise[1]};
    options.noise.resize(0);
    options.sensor = {};
    for (const orbits::Segment& segment : orbits::simulate(*e.system, e.binding.base, options).series.segments)
        e.states.push_back(segment.values);
    estimator::RandomStream random(seed, estimator::RandomPurpose::multi_start, 0);
    free_parameter(e, "l", 0.317 * (1.1 + 0.39 * random.uniform()), estimator::Scale::log, 0.1);
    e.parameters.back().upper = 2.0;
    for (const auto& [name, value] : {std::pair{"k1", 1e-3}, {"k2", 4.85e-4}, {"k3", 1.9e-4}})
        free_parameter(e, name, value * (0.1 + 3.9 * random.uniform()), estimator::Scale::linear, 0.0);
    return e;
}

Experiment lorenz(double duration, std::uint64_t seed) {
    Experiment e;
    e.system = models::make_system("lorenz");
    e.binding.base = e.system->default_parameters();
    orbits::VirtualExperimentOptions options;
    options.plan = orbits::SamplePlan{0.01, static_cast<std::size_t>(std::lround(duration / 0.01)) + 1, 0};
    options.initial = Eigen::Vector3d(1.0, 0.0, 0.0);
    options.noise = Eigen::Vector3d::Constant(0.5);
    options.seed = seed;
    const std::array<const char*, 3> names{"sigma", "rho", "beta"};
    const std::array<double, 3> truth{10.0, 28.0, 2.66};
    const std::array<double, 3> start{1.0, 2.2, 0.2};
    for (std::size_t i = 0; i < 3; ++i)
        e.binding.base[e.system->parameter_index(names[i])] = truth[i];
    e.series = orbits::simulate(*e.system, e.binding.base, options).series;
    e.errors.assign(3, 0.5);
    for (std::size_t i = 0; i < 3; ++i)
        free_parameter(e, names[i], start[i], estimator::Scale::linear, 0.0);
    return e;
}

struct Outcome {
    estimator::Estimate stage0;
    estimator::Estimate estimate;
    double seconds0 = 0.0, seconds = 0.0;
    std::unique_ptr<orbits::ShootingResidual> residual;
};

Eigen::VectorXd values(const estimator::Estimate& estimate) {
    Eigen::VectorXd theta(static_cast<Eigen::Index>(estimate.parameters.size()));
    for (std::size_t i = 0; i < estimate.parameters.size(); ++i)
        theta[static_cast<Eigen::Index>(i)] = estimate.parameters[i].value;
    return theta;
}

Outcome identify(const Experiment& e, bool verbose) {
    Outcome result;
    auto parameters = e.parameters;
    const double t0 = now();
    Eigen::VectorXd theta(e.binding.estimated_count);
    for (std::size_t i = 0; i < parameters.size(); ++i)
        theta[static_cast<Eigen::Index>(i)] = parameters[i].start;
    {
        const auto starts = orbits::transitions(*e.system, e.binding.values(theta), e.series, e.sensor, {}, 1, 2000, 1);
        Eigen::MatrixXd states(e.system->dimension(), std::ssize(starts));
        for (std::size_t k = 0; k < starts.size(); ++k)
            states.col(static_cast<Eigen::Index>(k)) = starts[k].from;
        orbits::PredictionOptions options;
        options.sizes = orbits::error_sizes(e.sensor, orbits::coordinate_range(*e.system, e.series, states));
        orbits::PredictionResidual prediction({e.system}, e.binding, starts,
                                              orbits::transition_clock(*e.system, e.series), theta, options);
        estimator::EstimateOptions rough;
        rough.verdict = false;
        rough.clusters = estimator::Clusters::none;
        rough.step_tolerance = 1e-2;
        result.stage0 = estimator::estimate(parameters, {&prediction}, {}, rough);
    }
    result.seconds0 = now() - t0;
    if (result.stage0.status != estimator::EstimateStatus::failed) theta = values(result.stage0);
    if (verbose) {
        std::printf("# stage 0: %s, %s, %d iterations, %d evaluations, %.2f s:",
                    std::string(name(result.stage0.status)).c_str(), result.stage0.message.c_str(),
                    result.stage0.iterations, result.stage0.evaluations, result.seconds0);
        for (Eigen::Index i = 0; i < theta.size(); ++i)
            std::printf(" %+.2f %%", 100.0 * (theta[i] / e.truth[i] - 1.0));
        std::printf("\n");
    }
    for (std::size_t i = 0; i < parameters.size(); ++i)
        parameters[i].start = theta[static_cast<Eigen::Index>(i)];
    const double t1 = now();
    orbits::ShootingOptions options;
    options.sensor = e.sensor;
    options.start = theta;
    result.residual = std::make_unique<orbits::ShootingResidual>(e.system, e.binding, e.series, options);
    estimator::EstimateOptions full;
    full.verdict = false;
    full.clusters = estimator::Clusters::none;
    full.step_tolerance = 1e-2;
    if (verbose) {
        std::printf("# %zu nodes, interval %td, first matching sd %.3g\n", result.residual->plan().nodes.size(),
                    result.residual->interval(), result.residual->matching_sd(result.residual->initial_set())[0]);
        full.progress = [&](int iteration, double objective) {
            std::printf("#   %d: %.6g, %.2f s\n", iteration, objective, now() - t1);
            std::fflush(stdout);
        };
    }
    result.estimate = estimator::estimate(parameters, {result.residual.get()}, {}, full);
    result.seconds = now() - t1;
    return result;
}

/// Sds of an efficient estimate: the information at the true parameters and states.
Eigen::VectorXd bound(const Experiment& e) {
    auto parameters = e.parameters;
    for (std::size_t i = 0; i < parameters.size(); ++i)
        parameters[i].start = e.truth[static_cast<Eigen::Index>(i)];
    orbits::ShootingOptions options;
    options.sensor = e.sensor;
    options.start = e.truth;
    options.interval = 1;
    options.nodes = e.states;
    orbits::ShootingResidual residual(e.system, e.binding, e.series, options);
    estimator::EstimateOptions one;
    one.verdict = false;
    one.clusters = estimator::Clusters::none;
    one.maximum_iterations = 1;
    const auto estimate = estimator::estimate(parameters, {&residual}, {}, one);
    Eigen::VectorXd sds(std::ssize(estimate.parameters));
    for (std::size_t i = 0; i < estimate.parameters.size(); ++i)
        sds[static_cast<Eigen::Index>(i)] = estimate.parameters[i].sd;
    return sds;
}

/// How far estimates are from the truth, in their sds, over many experiments.
struct Coverage {
    struct Row {
        std::string name;
        int count = 0, inside = 0;
        double square = 0.0, largest = 0.0, log_sd = 0.0, bias = 0.0, over_bound = 0.0;
    };
    std::vector<Row> rows;
    int failed = 0;

    void add(const Experiment& e, const estimator::Estimate& estimate, const Eigen::VectorXd& least) {
        if (rows.empty()) {
            for (const auto& p : estimate.parameters)
                rows.emplace_back().name = p.name;
            for (std::size_t g = 0; g < e.errors.size(); ++g)
                rows.emplace_back().name = estimate.scales[g].group;
        }
        if (estimate.status == estimator::EstimateStatus::failed) {
            ++failed;
            return;
        }
        if (estimate.status != estimator::EstimateStatus::converged) ++failed;
        for (std::size_t g = 0; g < e.errors.size(); ++g) {
            const auto& scale = estimate.scales[g];
            Row& row = rows[estimate.parameters.size() + g];
            ++row.count;
            if (scale.lower95 <= e.errors[g] && e.errors[g] <= scale.upper95) ++row.inside;
            const double z = (scale.value - e.errors[g]) / scale.uncertainty;
            row.square += z * z;
            row.bias += z;
            row.largest = std::max(row.largest, std::abs(z));
            row.log_sd += std::log(scale.uncertainty / e.errors[g]);
        }
        for (std::size_t i = 0; i < estimate.parameters.size(); ++i) {
            const auto& p = estimate.parameters[i];
            const double truth = e.truth[static_cast<Eigen::Index>(i)];
            const double z = (p.value - truth) / p.sd;
            Row& row = rows[i];
            ++row.count;
            if (p.lower95 <= truth && truth <= p.upper95) ++row.inside;
            if (!std::isfinite(z)) continue;
            row.square += z * z;
            row.bias += z;
            row.largest = std::max(row.largest, std::abs(z));
            row.log_sd += std::log(p.sd / truth);
            if (least.size() > 0)
                row.over_bound += std::pow((p.value - truth) / least[static_cast<Eigen::Index>(i)], 2);
        }
    }
    /// Where a bound was computed.
    static std::string over_bound(const Row& row) {
        if (!(row.over_bound > 0.0)) return {};
        std::array<char, 64> text{};
        std::snprintf(text.data(), text.size(), ", rms error / bound %.3f", std::sqrt(row.over_bound / row.count));
        return text.data();
    }
    void print() const {
        for (const Row& row : rows)
            std::printf("%-14s covered %d of %d, rms z %.3f, mean z %+.3f, largest %.2f, typical sd %.3g relative%s\n",
                        row.name.c_str(), row.inside, row.count, std::sqrt(row.square / row.count),
                        row.bias / row.count, row.largest, std::exp(row.log_sd / row.count), over_bound(row).c_str());
        std::printf("not converged: %d\n", failed);
    }
};

void show(const Experiment& e, const Outcome& o, std::uint64_t seed) {
    std::printf("seed %llu: %s (%s), %d iterations, %d evaluations, %.2f s\n", static_cast<unsigned long long>(seed),
                std::string(name(o.estimate.status)).c_str(), o.estimate.message.c_str(), o.estimate.iterations,
                o.estimate.evaluations, o.seconds0 + o.seconds);
    for (std::size_t i = 0; i < o.estimate.parameters.size(); ++i) {
        const auto& p = o.estimate.parameters[i];
        const double truth = e.truth[static_cast<Eigen::Index>(i)];
        std::printf("  %-6s %+.2e relative, sd %.2e, z %+.2f\n", p.name.c_str(), p.value / truth - 1.0, p.sd / truth,
                    (p.value - truth) / p.sd);
    }
    for (const auto& s : o.estimate.scales)
        std::printf("  %-20s sd %.4g +- %.2g, rms %.4g, %zu records\n", s.group.c_str(), s.value, s.uncertainty, s.rms,
                    s.count);
    std::fflush(stdout);
}

}  // namespace

int main(int argc, char** argv) {
    const std::string task = argc > 1 ? argv[1] : "pendulum";
    if (task == "pendulum") {
        const auto sections = static_cast<std::size_t>(argc > 2 ? std::atol(argv[2]) : 5000);
        const double noise = argc > 3 ? std::atof(argv[3]) : 0.0;
        const int replicates = argc > 4 ? std::atoi(argv[4]) : 1;
        const auto first = static_cast<std::uint64_t>(argc > 5 ? std::atol(argv[5]) : 1);
        Coverage coverage;
        for (int r = 0; r < replicates; ++r) {
            const std::uint64_t seed = first + static_cast<std::uint64_t>(r);
            const Experiment e = pendulum(sections, noise, seed);
            if (replicates == 1)
                std::printf("# %zu segments, %zu sections\n", e.series.segments.size(), e.series.size());
            const Outcome o = identify(e, replicates == 1);
            show(e, o, seed);
            coverage.add(e, o.estimate, bound(e));
        }
        coverage.print();
    } else if (task == "lorenz") {
        const double duration = argc > 2 ? std::atof(argv[2]) : 30.0;
        const int replicates = argc > 3 ? std::atoi(argv[3]) : 1;
        Coverage coverage;
        for (int r = 0; r < replicates; ++r) {
            const Experiment e = lorenz(duration, static_cast<std::uint64_t>(r + 1));
            const Outcome o = identify(e, replicates == 1);
            show(e, o, static_cast<std::uint64_t>(r + 1));
            coverage.add(e, o.estimate, {});
            double chi2 = 0.0;
            std::size_t count = 0;
            for (std::size_t g = 0; g < 3; ++g) {
                const auto& scale = o.estimate.scales[g];
                chi2 += static_cast<double>(scale.count) * scale.rms * scale.rms / 0.25;
                count += scale.count;
            }
            std::printf("  chi2 per value %.4f\n", chi2 / static_cast<double>(count));
        }
        coverage.print();
    } else if (task == "length") {
        // A given number of steps from the same start.
        double first = 0.0, first_length = 0.0;
        for (const std::size_t sections : {std::size_t{10000}, std::size_t{100000}, std::size_t{1000000}}) {
            if (argc > 2 && sections > static_cast<std::size_t>(std::atol(argv[2]))) break;
            const Experiment e = pendulum(sections, 0.0, 1);
            const Outcome o = identify(e, false);
            show(e, o, 1);
            const double length = static_cast<double>(e.series.size());
            std::printf("%8zu sections: %.2f s in all, %.3f us per section and evaluation", e.series.size(), o.seconds,
                        1e6 * o.seconds / length / o.estimate.evaluations);
            if (first > 0.0)
                std::printf(", slope of an evaluation %.3f",
                            std::log(o.seconds / o.estimate.evaluations / first) / std::log(length / first_length));
            else
                first = o.seconds / o.estimate.evaluations, first_length = length;
            std::printf("\n");
            std::fflush(stdout);
        }
    } else {
        std::printf("calibration_bench: no such task: %s\n", task.c_str());
        return 2;
    }
}
