// Periods of records in closed form, of a model's limit cycle, and of what does not repeat.
#include "orbits/sections/record_period.hpp"

#include <cmath>
#include <functional>
#include <limits>
#include <numbers>

#include "estimator/interface/random_stream.hpp"
#include "models/catalogue/registry.hpp"
#include "orbits/records/data_error.hpp"
#include "orbits/simulation/virtual_experiment.hpp"
#include "tests/catch.hpp"

namespace record_period_test {

using namespace orbid;
using orbits::record_period;
using orbits::RecordPeriod;
using orbits::Series;
using tests::ContainsSubstring;
using tests::WithinAbs;
using tests::WithinRel;

namespace {

constexpr double turn = 2.0 * std::numbers::pi;

Series sampled(const std::function<double(double)>& f, double step, Eigen::Index count, double noise = 0.0,
               bool angle = false) {
    Series series;
    series.sampling = Series::Sampling::samples;
    series.coordinates = {{"u", "V", angle}};
    Eigen::MatrixXd values(1, count);
    Eigen::VectorXd times(count);
    estimator::RandomStream random(7, estimator::RandomPurpose::reading_noise, 0);
    for (Eigen::Index k = 0; k < count; ++k) {
        times[k] = step * static_cast<double>(k);
        values(0, k) = f(times[k]) + (noise > 0.0 ? noise * random.normal() : 0.0);
    }
    series.segments.push_back({"0", values, times, {}});
    return series;
}

/// Five pulses of different heights in 3.7 s.
double pulses(double t) {
    constexpr double period = 3.7;
    const double place = 5.0 * (t / period - std::floor(t / period));
    const double heights[] = {1.0, 0.4, 0.8, 0.55, 0.7};
    return heights[static_cast<int>(place)] * std::pow(std::sin(std::numbers::pi * place), 2.0);
}

}  // namespace

TEST_CASE("the period of a record in closed form, with and without noise", "[orbits][period]") {
    for (const double noise : {0.0, 0.005, 0.03}) {
        CAPTURE(noise);
        const RecordPeriod found = record_period(sampled(pulses, 0.0371, 2000, noise));
        CHECK(found.periodic);
        // Measured 1.3e-5 without noise, 6e-5 with 0.03 (a tenth of the pulses' sd).
        CHECK_THAT(found.time, WithinRel(3.7, 6e-4));
        CHECK(found.maxima == 5);
        CHECK_THAT(found.periods, WithinRel(2000 * 0.0371 / 3.7, 1e-3));
        // The variance of pulses() is 0.077; the distance is that of the noise.
        CHECK_THAT(found.distance, WithinAbs(noise / std::sqrt(0.077), 0.01));
    }
}

TEST_CASE("a doubled period is told from half of it as soon as the noise allows", "[orbits][period]") {
    // The sub-harmonic moves every second maximum by two per cent.
    const auto doubled = [](double t) { return std::cos(turn * t) + 0.02 * std::cos(0.5 * turn * t); };
    CHECK_THAT(record_period(sampled(doubled, 0.03, 2000)).time, WithinRel(2.0, 1e-4));
    CHECK_THAT(record_period(sampled(doubled, 0.03, 2000, 0.01)).time, WithinRel(2.0, 1e-3));
    CHECK_THAT(record_period(sampled(doubled, 0.03, 2000, 0.2)).time, WithinRel(1.0, 1e-3));
    CHECK(record_period(sampled(doubled, 0.03, 2000)).maxima == 2);
}

TEST_CASE("angles that run on, holes and short segments do not spoil a period", "[orbits][period]") {
    // A rotation with a wobble: the angle itself never repeats, modulo a turn it does after 2 s.
    const auto rotation = [](double t) { return turn * t / 2.0 + 0.4 * std::sin(turn * t / 2.0); };
    const RecordPeriod found = record_period(sampled(rotation, 0.05, 1000, 0.0, true));
    CHECK(found.periodic);
    CHECK_THAT(found.time, WithinRel(2.0, 1e-4));

    Series holes = sampled(pulses, 0.0371, 2000, 0.01);
    for (Eigen::Index k = 0; k < 2000; k += 7)
        holes.segments[0].values(0, k) = std::numeric_limits<double>::quiet_NaN();
    CHECK_THAT(record_period(holes).time, WithinRel(3.7, 6e-4));

    // Two periods in the longest of three segments suffice.
    Series pieces = sampled(pulses, 0.0371, 220);
    pieces.segments.push_back(sampled(pulses, 0.0371, 90).segments[0]);
    CHECK_THAT(record_period(pieces).time, WithinRel(3.7, 2e-3));
}

TEST_CASE("a chaotic record has no period, a limit cycle has its own", "[orbits][period]") {
    const auto simulated = [](const char* model, std::size_t count, double step, const Eigen::VectorXd& initial) {
        const auto system = models::make_system(model);
        orbits::VirtualExperimentOptions options;
        options.plan = orbits::SamplePlan{step, count, 4000};
        options.initial = initial;
        return simulate(*system, system->default_parameters(), options).series;
    };
    const RecordPeriod chaos = record_period(simulated("lorenz", 5000, 0.01, Eigen::Vector3d(1, 2, 20)));
    CHECK_FALSE(chaos.periodic);
    CHECK(chaos.distance > 0.5);
    CHECK_THAT(description(chaos, simulated("lorenz", 500, 0.01, Eigen::Vector3d(1, 2, 20))),
               ContainsSubstring("comes nearest to itself after"));
    // van der Pol, mu = 1: T = 6.6632868593231 (Amore, Boyd and Fernandez, Appl. Math. Comput. 317, 2018).
    const RecordPeriod cycle = record_period(simulated("van_der_pol", 2000, 0.1, Eigen::Vector2d(1, 0)));
    CHECK(cycle.periodic);
    CHECK_THAT(cycle.time, WithinRel(6.6632868593231, 1e-5));
    CHECK(cycle.maxima == 1);
}

TEST_CASE("what cannot have a period is said or refused", "[orbits][period]") {
    CHECK(record_period(sampled([](double) { return 3.0; }, 0.1, 500)).time == 0.0);
    CHECK(record_period(sampled([](double t) { return t; }, 0.1, 500)).time == 0.0);
    CHECK_FALSE(record_period(sampled([](double t) { return std::exp(-t) * std::cos(9.0 * t); }, 0.02, 500)).periodic);
    // One period and a half: it is not seen twice.
    CHECK_FALSE(record_period(sampled(pulses, 0.0371, 150)).time > 3.0);
    Series sections = sampled(pulses, 0.0371, 200);
    sections.sampling = Series::Sampling::section;
    CHECK_THROWS_AS(record_period(sections), std::invalid_argument);
    Series uneven = sampled(pulses, 0.0371, 200);
    uneven.segments[0].times[100] += 0.01;
    CHECK_THROWS_AS(record_period(uneven), orbits::DataError);
    const Eigen::Index wrong[] = {1};
    CHECK_THROWS_AS(record_period(sampled(pulses, 0.0371, 200), wrong), std::invalid_argument);
}

}  // namespace record_period_test
