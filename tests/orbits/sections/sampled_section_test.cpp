// Sections made from samples in time, against motions whose crossings are known on paper.
#include "orbits/sections/sampled_section.hpp"

#include <cmath>
#include <limits>
#include <numbers>

#include "models/system/stopped.hpp"
#include "tests/catch.hpp"
#include "tests/orbits/cycles/measured_cycles.hpp"

namespace sampled_section_test {

using namespace orbid;
using orbits::PlaneCrossing;
using orbits::Series;
using tests::ContainsSubstring;
using tests::WithinAbs;

namespace {

constexpr double turn = 2.0 * std::numbers::pi;
constexpr double missing = std::numeric_limits<double>::quiet_NaN();

// x = sin t, y = cos t, u = sin 2t + t / 50 from t = 1 on; x rises through 0 at 2 pi k with y = 1, u = 2 pi k / 50.
Series circle(Eigen::Index count, double step, double noise = 0.0, std::uint64_t seed = 1) {
    tests::NormalNumbers normal(seed);
    Series series;
    series.sampling = Series::Sampling::samples;
    series.coordinates = {{"x", "", false}, {"y", "", false}, {"u", "", false}};
    Eigen::MatrixXd values(3, count);
    Eigen::VectorXd times(count);
    for (Eigen::Index i = 0; i < count; ++i) {
        const double t = 1.0 + step * static_cast<double>(i);
        times[i] = t;
        values.col(i) << std::sin(t), std::cos(t), std::sin(2.0 * t) + t / 50.0;
        for (Eigen::Index d = 0; d < 3; ++d)
            if (noise > 0.0) values(d, i) += noise * normal();
    }
    series.segments.push_back({"a", values, times, {}});
    return series;
}

}  // namespace

TEST_CASE("crossings of a clean motion come out to the order of the interpolation", "[orbits][sampled]") {
    double before = 0.0;
    for (const double step : {0.2, 0.1}) {
        const auto section = plane_section(circle(static_cast<Eigen::Index>(102.0 / step), step), {0, 0.0, 1});
        REQUIRE(section.series.segments.size() == 1);
        const orbits::Segment& segment = section.series.segments[0];
        REQUIRE(segment.values.cols() == 16);
        CHECK(section.series.timed());
        CHECK(section.series.coordinates.size() == 2);
        CHECK(section.series.coordinates[1].name == "u");
        CHECK(section.breaks == 0);
        double worst = 0.0;
        for (Eigen::Index k = 0; k < 16; ++k) {
            const double t = turn * static_cast<double>(k + 1);
            worst = std::max({worst, std::abs(segment.times[k] - t), std::abs(segment.values(0, k) - 1.0),
                              std::abs(segment.values(1, k) - t / 50.0)});
        }
        // Degree 7 on 8 samples: the error falls as step^8, at least as step^6 where another window is chosen.
        if (before > 0.0) CHECK(worst < before / 64.0);
        before = worst;
    }
    CHECK(before < 1e-8);  // measured 7e-11: derived bound (2 h)^8 / 8! (7!! / 2^4)^2 = 8e-10
}

TEST_CASE("deviations of noisy crossings are those that their errors have", "[orbits][sampled]") {
    const double noise = 0.02;
    const auto section = plane_section(circle(60000, 0.02, noise), {0, 0.0, 1});
    REQUIRE(section.series.segments.size() == 1);
    const orbits::Segment& segment = section.series.segments[0];
    REQUIRE(segment.values.cols() == 191);
    CHECK_THAT(section.sample_deviation[0], WithinAbs(noise, 0.02 * noise));  // 4 sds of the estimate of a variance
    double squares = 0.0;
    for (Eigen::Index k = 0; k < segment.values.cols(); ++k) {
        const double t = turn * static_cast<double>(k + 1);
        squares += std::pow((segment.values(0, k) - 1.0) / segment.deviations(0, k), 2) +
                   std::pow((segment.values(1, k) - t / 50.0) / segment.deviations(1, k), 2);
    }
    // Mean square of 382 normal numbers: 1 +- 0.072; four sds and 10 % for the choice of the windows.
    CHECK_THAT(squares / 382.0, WithinAbs(1.0, 0.39));
    // Smoothing pays: samples alone have the sd `noise`, u also moves with the error of the time.
    CHECK(segment.deviations.row(0).maxCoeff() < 0.5 * noise);
    CHECK_THAT(section.reading_covariance(1, 1), WithinAbs(segment.deviations.row(1).squaredNorm() / 191.0, 1e-12));
}

TEST_CASE("no crossing is made up in a hole, and single missing samples are bridged", "[orbits][sampled]") {
    Series series = circle(2000, 0.05);
    const auto at = [](double t) { return static_cast<Eigen::Index>((t - 1.0) / 0.05); };
    series.segments[0].values.col(at(2.0 * turn)).setConstant(missing);  // just before a crossing
    series.segments[0].values.middleCols(at(5.0 * turn) - 20, 40).setConstant(missing);
    const auto section = plane_section(series, {0, 0.0, 1});
    CHECK(section.breaks == 1);
    REQUIRE(section.series.segments.size() == 2);
    CHECK(section.series.segments[0].times.size() == 4);
    CHECK(section.series.segments[1].times.size() == 11);
    CHECK(section.series.segments[0].label == "a");
    CHECK(section.series.segments[1].label == "a.1");
    CHECK_THAT(section.series.segments[0].times[1], WithinAbs(2.0 * turn, 1e-6));
    CHECK_THAT(section.series.segments[1].times[0], WithinAbs(6.0 * turn, 1e-6));
}

TEST_CASE("an angle crosses its value once a turn and not at the seam", "[orbits][sampled]") {
    Series series;
    series.sampling = Series::Sampling::samples;
    series.coordinates = {{"phi", "rad", true}, {"w", "", false}};
    Eigen::MatrixXd values(2, 1000);
    Eigen::VectorXd times(1000);
    for (Eigen::Index i = 0; i < 1000; ++i) {
        times[i] = 0.05 * static_cast<double>(i);
        values(0, i) = std::remainder(times[i] - 1.0, turn);
        values(1, i) = std::cos(times[i]);
    }
    series.segments.push_back({"0", values, times, {}});
    const auto section = plane_section(series, {0, 0.5, 1});
    REQUIRE(section.series.segments.size() == 1);
    REQUIRE(section.series.segments[0].times.size() == 8);
    for (Eigen::Index k = 0; k < 8; ++k)
        CHECK_THAT(section.series.segments[0].times[k], WithinAbs(1.5 + turn * static_cast<double>(k), 1e-8));
    CHECK_THROWS_WITH(plane_section(series, {0, 0.5, -1}), ContainsSubstring("phi = 0.5 is never crossed from above"));
}

TEST_CASE("stroboscopic sections take samples as they are where the sampling divides the period", "[orbits][sampled]") {
    Series series = circle(1000, 0.05, 0.01);
    series.segments[0].times.array() -= 1.0;  // samples at 0, 0.05, ...
    series.segments[0].values(1, 60) = missing;
    const auto exact = stroboscopic_section(series, 1.0, 0.0);
    CHECK(exact.windows.empty());
    REQUIRE(exact.series.segments[0].values.cols() == 50);
    CHECK(exact.series.segments[0].values(0, 7) == series.segments[0].values(0, 140));
    CHECK(std::isnan(exact.series.segments[0].values(1, 3)));
    CHECK_FALSE(exact.series.timed());

    // A phase between the samples, and a phase of the forcing at time 0.
    series = circle(1000, 0.05);
    series.phase = 0.3;
    const double period = 0.97, phase = 1.1;
    const auto between = stroboscopic_section(series, period, phase);
    CHECK(between.windows.size() == 3);
    const double first = period * (phase - 0.3) / turn;
    const double start = first + period * std::ceil((1.0 - first) / period);
    for (Eigen::Index k = 4; k < between.series.segments[0].values.cols() - 4; ++k)
        CHECK_THAT(between.series.segments[0].values(0, k),
                   WithinAbs(std::sin(start + period * static_cast<double>(k)), 1e-8));
    CHECK(between.series.phase == phase);
}

TEST_CASE("a section of samples asks whether to stop", "[orbits][sampled]") {
    const Series samples = circle(20000, 0.01, 0.01);
    const auto leaves = [](auto cut) {
        // Every question may be the one that is answered with yes.
        int questions = 0;
        cut([&] { return ++questions < 0; });
        CHECK(questions > 20);
        for (const int last : {1, 4, questions}) {
            int asked = 0;
            CHECK_THROWS_AS(cut([&] { return ++asked == last; }), models::Stopped);
        }
    };
    leaves([&](const auto& stop) { (void)plane_section(samples, {0, 0.0, 1}, stop); });
    leaves([&](const auto& stop) { (void)stroboscopic_section(samples, turn, 0.0, stop); });
}

TEST_CASE("sections of senseless samples are refused", "[orbits][sampled]") {
    Series series = circle(200, 0.05);
    CHECK_THROWS_WITH(plane_section(series, {3, 0.0, 1}), ContainsSubstring("must be in [0, 3), got 3"));
    CHECK_THROWS_WITH(plane_section(series, {0, 0.0, 0}), ContainsSubstring("direction must be 1 or -1, got 0"));
    CHECK_THROWS_WITH(plane_section(series, {0, missing, 1}), ContainsSubstring("value must be finite"));
    CHECK_THROWS_WITH(plane_section(series, {0, 7.0, 1}), ContainsSubstring("x = 7 is never crossed from below"));
    CHECK_THROWS_WITH(stroboscopic_section(series, 0.06, 0.0), ContainsSubstring("at least two sampling intervals"));
    series.segments[0].times[100] += 0.01;
    CHECK_THROWS_WITH(plane_section(series, {0, 0.0, 1}), ContainsSubstring("samples must be equidistant"));
    series.sampling = Series::Sampling::section;
    CHECK_THROWS_WITH(plane_section(series, {0, 0.0, 1}), ContainsSubstring("the series holds sections"));
}

TEST_CASE("a narrowed window misses a tenth", "[orbits][sections]") {
    // What a polynomial of odd degree misses in the middle of its window grows as half width^(degree + 1).
    using orbits::TimeWindow;
    orbits::Segment wave;
    wave.label = "0";
    wave.times = Eigen::VectorXd::LinSpaced(4001, 0.0, 4.0);
    wave.values = Eigen::MatrixXd((2.0 * wave.times.array()).sin().matrix().transpose());
    for (const TimeWindow best : {TimeWindow{1, 100}, TimeWindow{3, 200}, TimeWindow{5, 300}, TimeWindow{7, 400}}) {
        const TimeWindow narrow = narrowed(best);
        CAPTURE(best.degree, narrow.half_width);
        CHECK(narrow.degree == best.degree);
        const auto missed = [&](const TimeWindow& window) {
            return orbits::TimeSmoothing(wave, 0, false, 1e-3, window).at(2000, 0.0).value - wave.values(0, 2000);
        };
        // Whole samples: a part in 100 of a half width, times the degree and one; the next order, (0.4)^2 / 40.
        CHECK_THAT(missed(narrow) / missed(best), tests::WithinAbs(0.1, 0.01));
    }
    // An interpolation stays one.
    CHECK(orbits::narrowed({7, 4}).half_width == 4);
    CHECK(orbits::narrowed({1, 1}).half_width == 1);
}

}  // namespace sampled_section_test
