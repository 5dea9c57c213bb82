// Waveforms of cycles in one reading, against the orbits of the model that the reading was made with.
#include "orbits/cycles/cycle_waveform.hpp"

#include <array>
#include <cmath>

#include "models/catalogue/registry.hpp"
#include "orbits/cycles/cycle_search.hpp"
#include "orbits/cycles/near_return.hpp"
#include "orbits/records/data_error.hpp"
#include "orbits/sections/delay_embedding.hpp"
#include "orbits/sections/plane_choice.hpp"
#include "orbits/sections/sampled_section.hpp"
#include "orbits/simulation/virtual_experiment.hpp"
#include "tests/catch.hpp"

namespace cycle_waveform_test {

using namespace orbid;
using orbits::Series;
using tests::ContainsSubstring;
using tests::WithinAbs;
using tests::WithinRel;

namespace {

Series lorenz_x(std::size_t count, double noise) {
    const auto system = models::make_system("lorenz");
    orbits::VirtualExperimentOptions options;
    options.plan = orbits::SamplePlan{0.01, count, 2000};
    options.initial = Eigen::Vector3d(1.0, 2.0, 20.0);
    if (noise > 0.0) options.noise = Eigen::Vector3d::Constant(noise);
    Series series = simulate(*system, system->default_parameters(), options).series;
    series.coordinates.resize(1);
    series.segments[0].values.conservativeResize(1, Eigen::NoChange);
    return series;
}

/// The cycle AB, the shortest one of the Lorenz flow, from delays of x.
orbits::CycleWaveform shortest_cycle(const Series& record) {
    orbits::DelayEmbeddingOptions options;
    options.delay = 17;
    options.dimension = 3;
    options.rise = true;
    const Series states = embed(record, options).series;
    REQUIRE(states.coordinates[1].name == "x_rise");
    CHECK_THAT(states.segments[0].values(1, 5),
               WithinAbs(record.segments[0].values(0, 22) - record.segments[0].values(0, 5), 1e-12));
    const auto cut = plane_section(states, {1, 0.0, 1});
    orbits::CycleSearchOptions search;
    search.periods = {1};
    search.reading_covariance = cut.reading_covariance;
    const auto found = find_cycles(cut.series, search);
    REQUIRE(found.cycles.size() == 1);
    const std::array<Eigen::Index, 1> rows{0};
    const auto waveforms = cycle_waveforms(record, rows, cut.series, found.cycles);
    REQUIRE(waveforms.size() == 1);
    return waveforms.front();
}

}  // namespace

TEST_CASE("the waveform of a cycle is that of the model's orbit", "[orbits][cycles][waveform]") {
    for (const double noise : {0.0, 0.1}) {
        CAPTURE(noise);
        const orbits::CycleWaveform wave = shortest_cycle(lorenz_x(100000, noise));
        // T of AB: Viswanath, Nonlinearity 16 (2003), table 1.
        CHECK(std::abs(wave.time - 1.558652210) < 4.0 * wave.time_sd + 1e-4);
        CHECK(wave.time_sd < 5e-3 * wave.time);
        if (noise == 0.0) CHECK_THAT(wave.time, WithinRel(1.558652210, 1e-3));
        REQUIRE(wave.values.rows() == 1);
        REQUIRE(wave.times[0] == 0.0);
        REQUIRE(wave.times[wave.times.size() - 1] < wave.time);
        // AB is its own mirror image: x(t + T/2) = -x(t). Nothing in the analysis knows of it.
        double sum = 0.0;
        const Eigen::Index count = wave.times.size();
        const auto at = [&](double time) {
            time -= wave.time * std::floor(time / wave.time);
            Eigen::Index k = 0;
            while (k + 1 < count && wave.times[k + 1] <= time)
                ++k;
            const double end = k + 1 < count ? wave.times[k + 1] : wave.time;
            const double share = (time - wave.times[k]) / (end - wave.times[k]);
            return (1.0 - share) * wave.values(0, k) + share * wave.values(0, (k + 1) % count);
        };
        double number = 0.0;
        for (Eigen::Index k = 0; k < count; ++k) {
            const double both = wave.values(0, k) + at(wave.times[k] + 0.5 * wave.time);
            // What the section itself tells is no reading: its own point, where the record is clean.
            if (!std::isfinite(both)) continue;
            sum += both * both;
            number += 1.0;
        }
        REQUIRE(number >= static_cast<double>(count) - 4.0);
        // Of a range of 26; linear interpolation alone leaves 0.05.
        CHECK(std::sqrt(sum / number) < 0.3);
        CHECK((wave.deviations.array() > 0.0).all());
        CHECK(wave.deviations.maxCoeff() < 0.5);
    }
}

TEST_CASE("waveforms of what does not fit are refused", "[orbits][cycles][waveform]") {
    Series record = lorenz_x(3000, 0.0);
    Series section = record;
    const std::array<Eigen::Index, 1> rows{0};
    CHECK_THROWS_AS(cycle_waveforms(record, rows, section, {}), std::invalid_argument);
    section.sampling = Series::Sampling::section;
    orbits::Cycle cycle;
    cycle.period = 1;
    cycle.points = Eigen::MatrixXd::Zero(2, 1);
    CHECK_THROWS_AS(cycle_waveforms(record, rows, section, {cycle}), std::invalid_argument);
    const std::array<Eigen::Index, 1> beyond{1};
    CHECK_THROWS_AS(cycle_waveforms(record, beyond, section, {}), std::invalid_argument);
}

TEST_CASE("near returns of a short section", "[orbits][cycles][near]") {
    Series section;
    section.coordinates = {{"u", "", false}};
    Eigen::MatrixXd values(1, 7);
    values << 0.0, 1.0, 0.25, 0.1, 0.95, 0.5, 0.7;
    Eigen::VectorXd times(7);
    times << 0.0, 1.0, 2.5, 3.0, 4.5, 5.0, 6.0;
    section.segments.push_back({"0", values, times, {}});
    const std::array<int, 4> periods{1, 2, 3, 9};
    const auto found = near_returns(section, periods);
    REQUIRE(found.size() == 3);
    const double range = section.scale()[0];
    CHECK(found[0].period == 1);
    CHECK_THAT(found[0].distance, WithinRel(0.15 / range, 1e-12));
    CHECK_THAT(found[0].time, WithinAbs(0.5, 1e-12));
    CHECK_THAT(found[2].distance, WithinRel(0.05 / range, 1e-12));
    CHECK_THAT(found[2].begin, WithinAbs(1.0, 1e-12));
    CHECK_THAT(description(found), ContainsSubstring("period 3 to "));
    CHECK_THAT(description(found), ContainsSubstring("after 3.5 s from 1 s on"));
    const std::array<int, 1> none{0};
    CHECK_THROWS_AS(near_returns(section, none), std::invalid_argument);
}

}  // namespace cycle_waveform_test
