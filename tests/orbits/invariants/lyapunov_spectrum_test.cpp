#include "orbits/invariants/lyapunov_spectrum.hpp"

#include <cmath>
#include <limits>
#include <numbers>
#include <random>

#include "models/catalogue/registry.hpp"
#include "orbits/invariants/sample_stride.hpp"
#include "orbits/records/data_error.hpp"
#include "orbits/simulation/virtual_experiment.hpp"
#include "tests/catch.hpp"
#include "tests/orbits/cycles/true_cycles.hpp"
#include "tests/orbits/sections/map_series.hpp"

namespace lyapunov_spectrum_test {

using namespace orbid;
using Catch::Matchers::WithinAbs;
using orbits::lyapunov_spectrum;

namespace {

constexpr double turn = 2.0 * std::numbers::pi;

// Arnold's cat, both coordinates angles.
std::array<double, 2> cat_map(const std::array<double, 2>& x) {
    return {std::remainder(x[0] + x[1], turn), std::remainder(x[0] + 2.0 * x[1], turn)};
}
const double cat_exponent = std::log((3.0 + std::sqrt(5.0)) / 2.0);

std::array<double, 1> logistic(const std::array<double, 1>& x) {
    return {4.0 * x[0] * (1.0 - x[0])};
}

orbits::Series noisy(orbits::Series series, double share) {
    std::mt19937_64 random(3);
    std::normal_distribution<double> normal;
    const Eigen::VectorXd scale = series.scale();
    for (auto& segment : series.segments)
        for (Eigen::Index i = 0; i < segment.values.cols(); ++i)
            for (Eigen::Index d = 0; d < segment.values.rows(); ++d)
                segment.values(d, i) += share * scale[d] * normal(random);
    return series;
}

void check_within_three_sds(const orbits::LyapunovSpectrum& spectrum, Eigen::Index j, double exact) {
    CAPTURE(j, spectrum.exponents[j], spectrum.sds[j], exact);
    CHECK(std::abs(spectrum.exponents[j] - exact) < 3.0 * spectrum.sds[j]);
}

}  // namespace

TEST_CASE("exponents of the cat map are exact", "[orbits][lyapunov]") {
    // Everywhere the same derivative: nothing scatters, and linear images are fitted to rounding (1e-16 over radii of
    // 1e-2, averaged); circles are crossed everywhere.
    const auto series =
        tests::section_series({{"x", "rad", true}, {"y", "rad", true}}, {tests::iterate<2>(cat_map, {0.3, 0.2}, 3000)});
    const auto spectrum = lyapunov_spectrum(series);
    REQUIRE(spectrum.exponents.size() == 2);
    CHECK_THAT(spectrum.exponents[0], WithinAbs(cat_exponent, 1e-10));
    CHECK_THAT(spectrum.exponents[1], WithinAbs(-cat_exponent, 1e-10));
    CHECK(spectrum.sds[0] < 1e-10);
    CHECK(spectrum.lost == 0);
    CHECK(spectrum.steps > 2500);
    CHECK(spectrum.remarks.empty());
}

TEST_CASE("exponents of maps of one and three dimensions", "[orbits][lyapunov]") {
    const auto line = tests::section_series({{"x", "", false}}, {tests::iterate<1>(logistic, {0.3141}, 10000)});
    const auto one = lyapunov_spectrum(line);
    REQUIRE(one.exponents.size() == 1);
    check_within_three_sds(one, 0, std::numbers::ln2);
    // ln |f'| is unbounded, but its sums telescope: the sd falls like 1 / steps.
    CHECK(one.sds[0] < 3e-3);
    CHECK(one.dimension == 1.0);
    CHECK_THAT(one.divergence_rate, WithinAbs(std::numbers::ln2, 0.03 + 3.0 * one.divergence_sd));

    // The cat and the logistic map side by side.
    const auto both = [](const std::array<double, 3>& x) {
        const auto cat = cat_map({x[0], x[1]});
        return std::array<double, 3>{cat[0], cat[1], logistic({x[2]})[0]};
    };
    const auto space = tests::section_series({{"x", "rad", true}, {"y", "rad", true}, {"z", "", false}},
                                             {tests::iterate<3>(both, {0.3, 0.2, 0.3141}, 4000)});
    const auto three = lyapunov_spectrum(space);
    REQUIRE(three.exponents.size() == 3);
    // Locally quadratic: exact.
    CHECK_THAT(three.exponents[0], WithinAbs(cat_exponent, 1e-2));
    check_within_three_sds(three, 1, std::numbers::ln2);
    CHECK_THAT(three.exponents[2], WithinAbs(-cat_exponent, 1e-8));
    // All exponents sum to ln 2 within errors: the whole space.
    CHECK(three.dimension == 3.0);
}

TEST_CASE("exponents of the Henon map", "[orbits][lyapunov]") {
    constexpr Eigen::Index count = 1 << 14;
    static const auto series = tests::henon_series(count);
    static const auto spectrum = lyapunov_spectrum(series);
    // What the data choose, given here to save time.
    REQUIRE(spectrum.order == 3);
    REQUIRE(spectrum.neighbours == 22);
    orbits::LyapunovOptions cubic;
    cubic.order = 3;
    cubic.neighbours = 22;
    check_within_three_sds(spectrum, 0, 0.41922);
    CHECK(spectrum.sds[0] < 0.02 * 0.41922);
    // The map is quadratic and shrinks areas by 0.3 everywhere.
    CHECK_THAT(spectrum.exponents.sum(), WithinAbs(std::log(0.3), 1e-9));
    CHECK_THAT(spectrum.dimension, WithinAbs(1.2583, 0.01));
    // Three sds and 3 % for the curvature at 10 % of the range.
    CHECK_THAT(spectrum.divergence_rate, WithinAbs(0.41922, 0.0126 + 3.0 * spectrum.divergence_sd));

    SECTION("times turn rates per step into rates per second") {
        auto timed = series;
        timed.segments[0].times = Eigen::VectorXd::LinSpaced(count, 0.0, 2.0 * (count - 1));
        const auto rates = lyapunov_spectrum(timed, cubic);
        CHECK(rates.timed);
        CHECK_THAT(rates.mean_time, WithinAbs(2.0, 1e-9));
        CHECK_THAT(rates.exponents[0], WithinAbs(0.5 * spectrum.exponents[0], 1e-9));
        CHECK_THAT(rates.sds[1], WithinAbs(0.5 * spectrum.sds[1], 1e-9));
        CHECK_THAT(rates.divergence_rate, WithinAbs(0.5 * spectrum.divergence_rate, 1e-9));
    }
    SECTION("gaps and segments cut the products, not the accuracy") {
        auto broken = series;
        broken.segments.clear();
        for (int part = 0; part < 8; ++part)
            broken.segments.push_back({"", series.segments[0].values.middleCols(part * 2048, 2048), {}});
        for (Eigen::Index i = 700; i < 2048; i += 500)
            broken.segments[2].values(0, i) = std::numeric_limits<double>::quiet_NaN();
        const auto pieces = lyapunov_spectrum(broken, cubic);
        check_within_three_sds(pieces, 0, 0.41922);
        CHECK_THAT(pieces.exponents.sum(), WithinAbs(std::log(0.3), 1e-9));
    }
    SECTION("a budget of steps takes pieces from everywhere") {
        orbits::LyapunovOptions options = cubic;
        options.steps = 4000;
        const auto fewer = lyapunov_spectrum(series, options);
        CHECK(fewer.steps <= 4000);
        CHECK(fewer.steps >= 2000);
        check_within_three_sds(fewer, 0, 0.41922);
    }
    SECTION("readings with errors: a remark, and a bias not far above the attenuation") {
        orbits::LyapunovOptions options;
        options.steps = 2000;
        const auto rough = lyapunov_spectrum(noisy(series, 0.001), options);
        REQUIRE(rough.remarks.size() == 1);
        CHECK(rough.attenuation > 0.003);
        CHECK_THAT(rough.exponents[0], WithinAbs(0.41922, 2.0 * rough.attenuation + 3.0 * rough.sds[0]));
    }
}

TEST_CASE("a curve in the plane has one exponent", "[orbits][lyapunov]") {
    // The second coordinate remembers the first one before: a curve, and the direction across it is not in the data.
    const auto remembering = [](const std::array<double, 2>& x) {
        return std::array<double, 2>{4.0 * x[0] * (1.0 - x[0]), x[0] + 1e-13 * x[1]};
    };
    const auto spectrum = lyapunov_spectrum(tests::section_series(
        {{"x", "", false}, {"y", "", false}}, {tests::iterate<2>(remembering, {0.3141, 0.2}, 10000)}));
    check_within_three_sds(spectrum, 0, std::numbers::ln2);
    CHECK(std::isnan(spectrum.exponents[1]));
    CHECK(std::isnan(spectrum.sds[1]));
    CHECK(std::isnan(spectrum.dimension));
}

TEST_CASE("exponents of the pendulum's sections and of sampled flows", "[orbits][lyapunov]") {
    SECTION("pendulum") {
        const auto pendulum = models::make_system("parametric_pendulum");
        const auto series = tests::pendulum_record(*pendulum, 1 << 13, 0.0, 1);
        orbits::LyapunovOptions options;
        options.symmetry_signs = std::vector<double>{-1.0, -1.0};
        const auto spectrum = lyapunov_spectrum(series, options);
        // 0.758 +- 0.002 by integration of the variational equations.
        CHECK_THAT(spectrum.exponents[0], WithinAbs(0.758, 3.0 * std::hypot(spectrum.sds[0], 0.002)));
        CHECK(spectrum.sds[0] < 0.03);
    }
    SECTION("Lorenz, sampled") {
        const auto lorenz = models::make_system("lorenz");
        orbits::VirtualExperimentOptions options;
        options.plan = orbits::SamplePlan{.step = 0.02, .count = 10000, .transient = 1000};
        options.seed = 1;
        const auto series = simulate(*lorenz, lorenz->default_parameters(), options).series;
        CHECK(orbits::sample_stride(series) == 2);
        const auto spectrum = lyapunov_spectrum(series);
        REQUIRE(spectrum.timed);
        CHECK(spectrum.stride == 2);
        CHECK_THAT(spectrum.mean_time, WithinAbs(0.04, 1e-9));
        check_within_three_sds(spectrum, 0, 0.9056);
        CHECK_THAT(spectrum.exponents[1], WithinAbs(0.0, 3.0 * spectrum.sds[1]));
        // The sheet is thin: its exponent is good to a per cent. Divergence 41 / 3.
        CHECK_THAT(spectrum.exponents.sum(), WithinAbs(-41.0 / 3.0, 0.15));
        CHECK_THAT(spectrum.dimension, WithinAbs(2.062, 0.01));
    }
}

TEST_CASE("spectra refuse what they cannot mean", "[orbits][lyapunov]") {
    const auto series = tests::henon_series(2000);
    const auto refused = [&](const orbits::LyapunovOptions& options, const std::string& why) {
        CHECK_THROWS_WITH(lyapunov_spectrum(series, options), tests::ContainsSubstring(why));
    };
    refused({.order = 5}, "order must be 1 to 4");
    refused({.order = -1}, "order must be 1 to 4");
    refused({.order = 2, .neighbours = 7}, "neighbours must be at least 8");
    refused({.steps = 999}, "steps must be at least 1000");
    CHECK_THROWS_WITH(lyapunov_spectrum(tests::henon_series(400)), tests::ContainsSubstring("at least 500"));
    auto single = series;  // one point per segment
    single.segments.clear();
    for (Eigen::Index i = 0; i < 1500; ++i)
        single.segments.push_back({"", series.segments[0].values.col(i), {}});
    CHECK_THROWS_AS(lyapunov_spectrum(single), orbits::DataError);
    auto pairs = series;
    pairs.segments.clear();
    for (Eigen::Index i = 0; i < 1000; ++i)
        pairs.segments.push_back({"", series.segments[0].values.middleCols(2 * (i % 900), 2), {}});
    CHECK_THROWS_WITH(lyapunov_spectrum(pairs), tests::ContainsSubstring("longer than 40 steps"));
    auto constant = series;
    constant.segments[0].values.row(1).setConstant(1.0);
    CHECK_THROWS_AS(lyapunov_spectrum(constant), orbits::DataError);
}

}  // namespace lyapunov_spectrum_test
