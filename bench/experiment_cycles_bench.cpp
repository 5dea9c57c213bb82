// Tables IV and V of the paper repeated on its virtual experiment: 42 754 sections in several transients, read through
// the encoder, cycles alone; with and without noise of 5e-3 of the range added to the readings; what a harvest adds.
//
//     experiment_cycles_bench [NOISE [SEEDS [FIRST_SEED [HARVESTS]]]]
//         NOISE relative to the range; 10 seeds from 1; the first HARVESTS of them are harvested, 1
//     experiment_cycles_bench harvest
//         the clean series of table III, boxes of 1 %
//
// Errors in percent of the true values, z = error / reported sd.
#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <utility>
#include <vector>

#include "estimator/estimate/estimate.hpp"
#include "identification/starts/cycle_start.hpp"
#include "models/catalogue/registry.hpp"
#include "orbits/cycle_residuals/cycle_residual.hpp"
#include "orbits/cycles/cycle_search.hpp"
#include "orbits/cycles/model_guided_search.hpp"
#include "tests/orbits/cycles/measured_cycles.hpp"
#include "tests/orbits/cycles/true_cycles.hpp"

namespace {

using namespace orbid;
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using Clock = std::chrono::steady_clock;

double seconds_since(Clock::time_point start) {
    return std::chrono::duration<double>(Clock::now() - start).count();
}

struct FreeStart {
    std::string name;
    double factor;  ///< start relative to the truth
};

struct Experiment {
    std::shared_ptr<const models::System> system = models::make_system("parametric_pendulum");
    VectorXd theta;  ///< the truth
    models::Sensor sensor;
    orbits::Series series;
    orbits::CycleSearchOptions search;
};

// The covariance of a reading of angle and quotient: known from step and delay (mathematics.md, "Instrument").
MatrixXd reading_covariance(const models::Sensor& sensor, double noise) {
    const double q = sensor.step * sensor.step / 12.0, d = sensor.delay;
    MatrixXd covariance(2, 2);
    covariance << q, -q / d, -q / d, 2.0 * q / (d * d);
    covariance.diagonal() += (noise * tests::pendulum_range()).cwiseAbs2();
    return covariance;
}

Experiment virtual_experiment(double noise, std::uint64_t seed) {
    Experiment experiment;
    experiment.theta = tests::pendulum_at(*experiment.system, 1e-3);
    experiment.sensor = tests::pendulum_encoder();
    experiment.series = tests::encoder_record(*experiment.system, 42754, seed);
    const VectorXd sd = noise * tests::pendulum_range();
    tests::NormalNumbers normal(1000 + seed);
    if (noise > 0.0)
        for (orbits::Segment& segment : experiment.series.segments)
            for (Index k = 0; k < segment.values.size(); ++k)
                segment.values(k % 2, k / 2) += sd[k % 2] * normal();
    experiment.search.symmetry_signs = experiment.system->symmetry()->signs;
    experiment.search.reading_covariance = reading_covariance(experiment.sensor, noise);
    return experiment;
}

Experiment table_three() {
    Experiment experiment;
    experiment.theta = tests::pendulum_at(*experiment.system, 0.0);
    experiment.series = tests::pendulum_record(*experiment.system, std::size_t{1} << 20, 0.0, 1);
    experiment.search.symmetry_signs = experiment.system->symmetry()->signs;
    experiment.search.method = orbits::CycleSearchOptions::Method::local_maps;
    experiment.search.box = 0.01;
    return experiment;
}

struct Result {
    estimator::Estimate estimate;
    VectorXd theta;  ///< full vector at the estimate
    std::vector<Index> free;
    VectorXd error, z;  ///< relative, over the sd
};

// From the starts given to the end: one-period prediction, lifted cycles, re-solved orbits.
Result estimate(const Experiment& experiment, const std::vector<orbits::Cycle>& cycles,
                const std::vector<FreeStart>& starts) {
    std::vector<estimator::FreeParameter> parameters;
    models::ParameterBinding binding;
    binding.base = experiment.theta;
    for (const FreeStart& start : starts) {
        const Index index = experiment.system->parameter_index(start.name);
        estimator::FreeParameter parameter;
        parameter.name = start.name;
        parameter.start = start.factor * experiment.theta[index];
        parameter.lower = 0.0;
        parameter.typical_size = experiment.system->parameters()[static_cast<std::size_t>(index)].typical_size;
        binding.parameter.push_back(index);
        binding.estimated.push_back(static_cast<Index>(parameters.size()));
        parameters.push_back(parameter);
    }
    binding.estimated_count = static_cast<Index>(parameters.size());
    orbits::CycleTargetOptions targets;
    targets.sensor = experiment.sensor;
    const identification::CycleStart start =
        identification::start_from_cycles({experiment.system, binding, cycles, 0.0, targets}, parameters, {});
    for (std::size_t i = 0; i < parameters.size(); ++i)
        parameters[i].start = start.theta[static_cast<Index>(i)];
    orbits::CycleResidualOptions options;
    options.targets = targets;
    orbits::CycleResidual residual(experiment.system, binding, cycles, 0.0, start.theta, start.nodes, options);
    Result result;
    result.estimate = estimator::estimate(parameters, {&residual});
    result.free = binding.parameter;
    result.theta = experiment.theta;
    result.error.resize(binding.estimated_count);
    result.z.resize(binding.estimated_count);
    for (Index i = 0; i < binding.estimated_count; ++i) {
        const auto& parameter = result.estimate.parameters[static_cast<std::size_t>(i)];
        const Index index = binding.parameter[static_cast<std::size_t>(i)];
        result.theta[index] = parameter.value;
        result.error[i] = parameter.value / experiment.theta[index] - 1.0;
        result.z[i] = (parameter.value - experiment.theta[index]) / parameter.sd;
    }
    return result;
}

void print(const char* name, const Result& result) {
    std::printf("  %-22s", name);
    for (std::size_t i = 0; i < result.free.size(); ++i) {
        const auto& parameter = result.estimate.parameters[i];
        const auto k = static_cast<Index>(i);
        std::printf(" %s %+.3g %% (sd %.2g, z %+.1f)", parameter.name.c_str(), 100.0 * result.error[k],
                    100.0 * result.error[k] / result.z[k], result.z[k]);
    }
    const auto& count = result.estimate.counts.at(0);
    std::printf("  used %d lost %d rejected %d, factors", count.used, count.lost, count.rejected);
    for (const auto& scale : result.estimate.scales)
        std::printf(" %.2f", scale.value);
    std::printf(" %s\n", std::string(estimator::name(result.estimate.status)).c_str());
}

// Cycles that are the model's: found, true, median and worst position, error / sd.
void print_truth(const char* name, const Experiment& experiment, const std::vector<orbits::Cycle>& cycles) {
    const auto truths =
        tests::true_cycles(*experiment.system, experiment.theta, cycles, tests::pendulum_range(), experiment.sensor);
    std::printf("  %-10s", name);
    for (const int period : {1, 2, 3, 4, 5, 0}) {
        const auto s = tests::summary(cycles, truths, period);
        std::printf(" %zu/%zu", s.true_ones, s.found);
        if (s.repeated > 0) std::printf(" (%zu twice)", s.repeated);
        if (period == 0)
            std::printf(" position %.1e %.1e, multiplier %.1e, z rms %.2f largest %.1f, ln multiplier %.2f",
                        s.median_position, s.worst_position, s.median_multiplier, s.z_rms, s.z_largest,
                        s.ln_multiplier_z_rms);
    }
    std::printf("\n");
}

orbits::ModelGuidedSearch reap(const Experiment& experiment, const Result& result,
                               const std::vector<orbits::Cycle>& known) {
    orbits::ModelGuidedSearchOptions options;
    options.search = experiment.search;
    options.sensor = experiment.sensor;
    options.free = result.free;
    options.covariance = result.estimate.covariance;
    return model_guided_search(experiment.series, *experiment.system, result.theta, known, options);
}

std::vector<orbits::Cycle> joined(const std::vector<orbits::Cycle>& known, const orbits::ModelGuidedSearch& more) {
    std::vector<orbits::Cycle> all = known;
    for (std::size_t c = 0; c < all.size(); ++c)
        all[c].common = c < more.known_common.size() ? more.known_common[c] : Eigen::MatrixXd();
    for (orbits::Cycle cycle : more.cycles) {
        if (cycle.mirror) *cycle.mirror += known.size();
        all.push_back(std::move(cycle));
    }
    return all;
}

void print(const orbits::ModelGuidedSearch& harvest, double seconds) {
    std::printf(
        "  harvest    %zu cycles; orbits %zu, candidates %zu, not visited %zu, rejected %zu, known %zu; %.1f s\n",
        harvest.cycles.size(), harvest.orbits, harvest.candidates, harvest.not_visited, harvest.rejected, harvest.known,
        seconds);
}

const std::vector<FreeStart> table_four{{"m", 1.51}, {"l", 1.189}};
const std::vector<FreeStart> table_five{{"k3", 0.0}};
const std::vector<FreeStart> together{{"l", 1.189}, {"k2", 1.336}, {"k3", 1.334}};

// Root mean square and largest of errors and z over the seeds.
struct Spread {
    std::string name;
    double squares = 0.0, largest = 0.0, sum = 0.0, largest_z = 0.0;
    int count = 0;

    void add(double error, double z) {
        squares += error * error;
        sum += error;
        largest = std::max(largest, std::abs(error));
        largest_z = std::max(largest_z, std::abs(z));
        ++count;
    }
};

void tables(double noise, std::uint64_t seeds, std::uint64_t first, std::uint64_t harvests) {
    std::vector<Spread> spreads{{"IV m"}, {"IV l"}, {"V k3"}, {"IV m harvest"}, {"IV l harvest"}, {"V k3 harvest"}};
    for (std::uint64_t seed = first; seed < first + seeds; ++seed) {
        const Experiment experiment = virtual_experiment(noise, seed);
        const auto start = Clock::now();
        const auto cycles = find_cycles(experiment.series, experiment.search).cycles;
        std::printf("seed %llu, noise %g: %zu segments, %zu cycles in %.1f s\n", static_cast<unsigned long long>(seed),
                    noise, experiment.series.segments.size(), cycles.size(), seconds_since(start));
        print_truth("cycles", experiment, cycles);
        const Result four = estimate(experiment, cycles, table_four), five = estimate(experiment, cycles, table_five);
        print("table IV", four);
        print("table V", five);
        print("l, k2, k3", estimate(experiment, cycles, together));
        spreads[0].add(four.error[0], four.z[0]);
        spreads[1].add(four.error[1], four.z[1]);
        spreads[2].add(five.error[0], five.z[0]);
        std::fflush(stdout);
        if (seed >= first + harvests) continue;
        const auto again = Clock::now();
        const auto more = reap(experiment, four, cycles);
        print(more, seconds_since(again));
        print_truth("harvested", experiment, more.cycles);
        const auto all = joined(cycles, more);
        const Result four_more = estimate(experiment, all, table_four),
                     five_more = estimate(experiment, all, table_five);
        print("table IV, harvest", four_more);
        print("table V, harvest", five_more);
        spreads[3].add(four_more.error[0], four_more.z[0]);
        spreads[4].add(four_more.error[1], four_more.z[1]);
        spreads[5].add(five_more.error[0], five_more.z[0]);
        std::fflush(stdout);
    }
    for (const Spread& spread : spreads)
        std::printf("%-13s mean %+.4f %%, rms %.4f %%, largest %.4f %%, largest z %.1f, %d seeds\n",
                    spread.name.c_str(), 100.0 * spread.sum / spread.count,
                    100.0 * std::sqrt(spread.squares / spread.count), 100.0 * spread.largest, spread.largest_z,
                    spread.count);
}

void clean_harvest() {
    const Experiment experiment = table_three();
    const auto cycles = find_cycles(experiment.series, experiment.search).cycles;
    print_truth("cycles", experiment, cycles);
    const Result before = estimate(experiment, cycles, together);
    print("table III", before);
    const auto start = Clock::now();
    const auto more = reap(experiment, before, cycles);
    print(more, seconds_since(start));
    print_truth("harvested", experiment, more.cycles);
    print("table III, harvest", estimate(experiment, joined(cycles, more), together));
}

}  // namespace

int main(int argc, char** argv) {
    if (argc > 1 && std::string(argv[1]) == "harvest") {
        clean_harvest();
        return 0;
    }
    const double noise = argc > 1 ? std::atof(argv[1]) : 0.0;
    const auto seeds = argc > 2 ? std::strtoull(argv[2], nullptr, 10) : 10;
    const auto first = argc > 3 ? std::strtoull(argv[3], nullptr, 10) : 1;
    const auto harvests = argc > 4 ? std::strtoull(argv[4], nullptr, 10) : 1;
    tables(noise, seeds, first, harvests);
    return 0;
}
