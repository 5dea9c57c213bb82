// Cycles of sections that are curves blurred by noise, and the times in which cycles close.
#include <algorithm>
#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "models/catalogue/registry.hpp"
#include "orbits/cycles/cycle_search.hpp"
#include "orbits/sections/sampled_section.hpp"
#include "orbits/simulation/virtual_experiment.hpp"
#include "tests/catch.hpp"
#include "tests/orbits/cycles/measured_cycles.hpp"
#include "tests/orbits/sections/map_series.hpp"
#include "tests/source_folder.hpp"

namespace manifold_cycles_test {

using namespace orbid;
using orbits::Cycle;
using orbits::Series;
using tests::WithinAbs;

namespace {

// x -> 1 - 2 x^2 with return times 1 + x / 4, and a second coordinate that follows the first on a curve.
Series curve_series(Eigen::Index count, double noise, std::uint64_t seed) {
    const Eigen::MatrixXd states = tests::iterate<1>(
        [](const std::array<double, 1>& x) { return std::array<double, 1>{1.0 - 2.0 * x[0] * x[0]}; }, {0.3123}, count);
    Series series = tests::section_series({{"x", "", false}, {"y", "", false}}, {Eigen::MatrixXd(2, count)});
    tests::NormalNumbers normal(seed);
    orbits::Segment& segment = series.segments[0];
    segment.times.resize(count);
    double time = 0.0;
    for (Eigen::Index i = 0; i < count; ++i) {
        const double x = states(0, i);
        segment.values.col(i) << x + noise * normal(), x + 0.3 * x * x + noise * normal();
        segment.times[i] = time;
        time += 1.0 + 0.25 * x;
    }
    return series;
}

// Samples of a flow with normal errors of 1 % of each coordinate's range.
Series noisy_samples(const std::string& model, std::size_t count) {
    const auto system = models::make_system(model);
    orbits::VirtualExperimentOptions options;
    options.plan = orbits::SamplePlan{0.01, count, 10000};
    options.initial = Eigen::Vector3d(1.0, 2.0, 3.0);
    options.seed = 5;
    Series clean = simulate(*system, system->default_parameters(), options).series;
    options.noise = 0.01 * clean.scale();
    return simulate(*system, system->default_parameters(), options).series;
}

struct Reference {
    std::size_t period;
    double time;
};

std::vector<Reference> reference_times(const std::string& file) {
    std::ifstream stream(orbid::tests::source_folder() + "/tests/reference/" + file);
    const nlohmann::json table = nlohmann::json::parse(stream);
    std::vector<Reference> result;
    for (const auto& cycle : table["cycles"])
        result.push_back({cycle["code"].get<std::string>().size(), std::stod(cycle["period"].get<std::string>())});
    return result;
}

}  // namespace

TEST_CASE("clean cycles close in the sum of their return times", "[orbits][cycles][time]") {
    orbits::CycleSearchOptions options;
    options.periods = {1, 2, 3};
    Series series = curve_series(20000, 0.0, 1);
    series.coordinates.pop_back();
    series.segments[0].values.conservativeResize(1, Eigen::NoChange);
    const auto search = find_cycles(series, options);
    REQUIRE(search.cycles.size() >= 4);
    for (const Cycle& cycle : search.cycles) {
        // The return time is linear in x and fitted exactly.
        CHECK_THAT(cycle.time, WithinAbs(cycle.period + 0.25 * cycle.points.row(0).sum(), 1e-8));
        CHECK(cycle.time_sd > 0.0);
        CHECK(cycle.time_sd < 1e-3);
    }
    series.segments[0].times.resize(0);
    const auto untimed = find_cycles(series, options);
    CHECK(std::isnan(untimed.cycles.at(0).time));
}

TEST_CASE("cycles on a curve blurred by noise lie within their errors", "[orbits][cycles][sheet]") {
    orbits::CycleSearchOptions options;
    options.periods = {1, 2};
    options.box = 0.1;
    options.minimum_recurrences = 1;
    const Series series = curve_series(8000, 0.01, 2);
    const auto search = find_cycles(series, options);
    REQUIRE(search.remarks.size() == 1);
    CHECK_THAT(search.remarks[0], tests::ContainsSubstring("sheet of 1 dimension"));
    // x = 1/2 (multiplier -2) and (1 +- sqrt 5) / 4 (multiplier -4); the fixed point -1, the end of the curve, has
    // neighbours on one side only and may be found or not.
    const auto of_period = [&](int period, double x) {
        return std::find_if(search.cycles.begin(), search.cycles.end(), [&](const Cycle& cycle) {
            return cycle.period == period && std::abs(cycle.points.row(0).minCoeff() - x) < 0.05;
        });
    };
    const double low_x = (1.0 - std::sqrt(5.0)) / 4.0;
    REQUIRE(of_period(1, 0.5) != search.cycles.end());
    REQUIRE(of_period(2, low_x) != search.cycles.end());
    const Cycle& fixed = *of_period(1, 0.5);
    const Cycle& pair = *of_period(2, low_x);
    for (const Cycle& cycle : search.cycles)
        CHECK((&cycle == &fixed || &cycle == &pair || std::abs(cycle.points(0, 0) + 1.0) < 0.05));
    // Four sds, which are below a tenth of the noise, and a tenth of the noise for what second-order terms leave.
    const auto near = [](double value, double exact, double sd) {
        CHECK(sd < 0.001);
        CHECK_THAT(value, WithinAbs(exact, 4.0 * sd + 0.001));
    };
    near(fixed.points(0, 0), 0.5, std::sqrt(fixed.covariance(0, 0)));
    near(fixed.points(1, 0), 0.575, std::sqrt(fixed.covariance(1, 1)));
    near(fixed.time, 1.125, fixed.time_sd);
    REQUIRE(fixed.multipliers.size() == 1);
    CHECK_THAT(fixed.multipliers[0].real(), WithinAbs(-2.0, 0.1));
    const Eigen::Index first = pair.points(0, 0) < pair.points(0, 1) ? 0 : 1;
    near(pair.points(0, first), low_x, std::sqrt(pair.covariance(2 * first, 2 * first)));
    near(pair.time, 2.0 + 0.25 * 0.5, pair.time_sd);
}

TEST_CASE("a shuffled curve has no cycles", "[orbits][cycles][sheet]") {
    Series series = curve_series(5000, 0.01, 3);
    tests::NormalNumbers uniform(4);
    orbits::Readings& values = series.segments[0].values;
    for (Eigen::Index i = values.cols() - 1; i > 0; --i)
        values.col(i).swap(values.col(static_cast<Eigen::Index>(uniform.uniform() * static_cast<double>(i + 1))));
    orbits::CycleSearchOptions options;
    options.periods = {1, 2, 3};
    options.reading_covariance = Eigen::Vector2d(1e-4, 1e-4).asDiagonal();
    CHECK(find_cycles(series, options).cycles.empty());
}

TEST_CASE("the shortest orbits of Lorenz and Roessler from noisy samples", "[orbits][cycles][sheet]") {
    struct Flow {
        std::string model;
        orbits::PlaneCrossing crossing;
        std::vector<std::size_t> shortest;  // entries of the table
        bool symmetric;
        std::size_t samples;
    };
    // Lorenz AB, AAB, ABB, AAAB, AABB, ABBB; Roessler 1, 01, 001, 011, 0111 and 01011.
    const std::vector<Flow> flows{{"lorenz", {2, 27.0, 1}, {0, 1, 2, 3, 4, 5}, true, 400000},
                                  {"rossler", {0, 0.0, -1}, {0, 1, 2, 3, 4, 5}, false, 1000000}};
    for (const Flow& flow : flows) {
        CAPTURE(flow.model);
        const auto section = plane_section(noisy_samples(flow.model, flow.samples), flow.crossing);
        orbits::CycleSearchOptions options;
        if (flow.symmetric) options.periods = {1, 2, 3, 4};
        options.box = 0.06;
        options.minimum_recurrences = 1;
        if (flow.symmetric) options.symmetry_signs = std::vector<double>{-1.0, -1.0};
        const auto search = find_cycles(section.series, options);
        const auto table = reference_times(flow.model + "_orbits.json");
        int complete = 0;
        for (const std::size_t entry : flow.shortest) {
            const Reference& reference = table.at(entry);
            CAPTURE(entry, reference.period, reference.time);
            const auto expected =
                static_cast<std::size_t>(std::count_if(table.begin(), table.end(), [&](const Reference& other) {
                    return other.period == reference.period && std::abs(other.time - reference.time) < 1e-9;
                }));
            const auto found = static_cast<std::size_t>(
                std::count_if(search.cycles.begin(), search.cycles.end(), [&](const Cycle& cycle) {
                    return cycle.period == static_cast<int>(reference.period) &&
                           std::abs(cycle.time / reference.time - 1.0) < 1e-3;
                }));
            CHECK(found <= expected);  // partners of a mirror pair close in the same time
            complete += found == expected ? 1 : 0;
        }
        // All six of Lorenz. Roessler returns only 1700 times in this record: 6, 5, 5 and 4 of its six were reached
        // with four realisations of the noise.
        CHECK(complete >= (flow.symmetric ? 6 : 4));
        for (const Cycle& cycle : search.cycles)
            CHECK(std::any_of(table.begin(), table.end(), [&](const Reference& reference) {
                return reference.period == static_cast<std::size_t>(cycle.period) &&
                       std::abs(cycle.time / reference.time - 1.0) < 1e-3;
            }));
    }
}

}  // namespace manifold_cycles_test
