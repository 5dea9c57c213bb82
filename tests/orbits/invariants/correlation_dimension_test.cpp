#include "orbits/invariants/correlation_dimension.hpp"

#include <cmath>
#include <numbers>
#include <random>

#include "orbits/invariants/correlation_sum.hpp"
#include "orbits/invariants/invariants.hpp"
#include "orbits/records/data_error.hpp"
#include "tests/catch.hpp"
#include "tests/orbits/sections/map_series.hpp"

namespace correlation_dimension_test {

using namespace orbid;
using Catch::Matchers::WithinAbs;
using Catch::Matchers::WithinRel;
using orbits::correlation_dimension;

namespace {

constexpr double turn = 2.0 * std::numbers::pi;
const double golden = (std::sqrt(5.0) - 1.0) / 2.0;

// Independent points, uniform on the torus.
orbits::Series torus(Eigen::Index count) {
    std::mt19937_64 random(4);
    std::uniform_real_distribution<double> uniform(-std::numbers::pi, std::numbers::pi);
    Eigen::MatrixXd values(2, count);
    for (Eigen::Index i = 0; i < count; ++i)
        for (Eigen::Index d = 0; d < 2; ++d)
            values(d, i) = uniform(random);
    return tests::section_series({{"x", "rad", true}, {"y", "rad", true}}, {values});
}

orbits::Series logistic_series(Eigen::Index count) {
    const auto next = [](const std::array<double, 1>& x) { return std::array<double, 1>{4.0 * x[0] * (1.0 - x[0])}; };
    return tests::section_series({{"x", "", false}}, {tests::iterate<1>(next, {0.3141}, count)});
}

}  // namespace

TEST_CASE("pairs counted through boxes are those counted one by one", "[orbits][correlation]") {
    std::mt19937_64 random(1);
    std::uniform_real_distribution<double> uniform(-1.0, 1.0);
    for (const int dimension : {1, 2, 3, 4})
        for (const double radius : {0.4, 0.3, 0.1}) {
            CAPTURE(dimension, radius);
            Eigen::MatrixXd values(dimension, 700);
            std::vector<orbits::SeriesCoordinate> coordinates;
            for (int d = 0; d < dimension; ++d) {
                coordinates.push_back({"x" + std::to_string(d), "", d % 2 == 0});
                for (Eigen::Index i = 0; i < 700; ++i)
                    values(d, i) = (d % 2 == 0 ? 3.14 : 1.0) * uniform(random);
            }
            const orbits::SectionPoints points(tests::section_series(coordinates, {values}));
            std::vector<std::uint32_t> chosen;
            for (std::uint32_t i = 0; i < 700; i += 1 + i % 2)
                chosen.push_back(i);
            std::vector<std::uint8_t> ahead(700, 0);
            for (std::size_t i = 0; i + 16 < 700; ++i)
                ahead[i] = 16;
            constexpr std::size_t theiler = 7;
            const auto count = orbits::count_pairs(points, chosen, radius, theiler, ahead, 1);

            double candidates = 0.0, near = 0.0, nearer = 0.0, ln_ratio = 0.0, stay = 0.0, without_third = 0.0;
            const auto apart = [&](std::size_t i, std::size_t j) {
                double largest = 0.0;
                for (Eigen::Index d = 0; d < dimension; ++d)
                    largest = std::max(largest, std::abs(points.difference(points.point(i)[d], points.point(j)[d], d)));
                return largest;
            };
            for (std::size_t a = 0; a < chosen.size(); ++a)
                for (std::size_t b = a + 1; b < chosen.size(); ++b) {
                    const std::size_t i = chosen[a], j = chosen[b];
                    if (j - i <= theiler) continue;
                    candidates += 1.0;
                    if (!(apart(i, j) < radius)) continue;
                    near += 1.0;
                    if (apart(i, j) < radius / 2.0) nearer += 1.0;
                    ln_ratio += std::log(radius / apart(i, j));
                    if (a * 16 / chosen.size() != 3 && b * 16 / chosen.size() != 3) without_third += 1.0;
                    if (j + 16 < 700 && apart(i + 1, j + 1) < radius) stay += 1.0;
                }
            REQUIRE(near > 0.0);
            CHECK(count.candidates == candidates);
            CHECK(count.all.within[0] == near);
            CHECK(count.all.within[2] == nearer);
            CHECK(count.all.different == near);
            CHECK_THAT(count.all.ln_ratio, WithinRel(ln_ratio, 1e-12));
            CHECK(count.all.stay[1] == stay);
            CHECK(count.without(3).within[0] == without_third);
        }
}

TEST_CASE("correlation sums and dimensions of tori are exact", "[orbits][correlation]") {
    // Uniform on the square torus: C(r) = (2 r)^2 in the largest-coordinate norm, r in turns.
    const auto square = correlation_dimension(torus(30000));
    REQUIRE(square.scales.size() > 6);
    for (const auto& scale : square.scales) {
        CAPTURE(scale.radius, scale.points, scale.pairs);
        // Pairs of independent uniform points are uncorrelated: Poisson, five sds.
        const double exact = 4.0 * scale.radius * scale.radius;
        CHECK_THAT(scale.sum, WithinRel(exact, 5.0 / std::sqrt(static_cast<double>(scale.pairs))));
        CHECK(std::abs(scale.slope - 2.0) < 5.0 * scale.slope_sd);
    }
    CHECK_THAT(square.dimension, WithinAbs(2.0, 3.0 * square.sd));
    CHECK_THAT(square.takens, WithinAbs(2.0, 5.0 * square.takens_sd));
    CHECK(square.takens_sd < 0.01);
    CHECK(square.theiler == 10);
    CHECK_FALSE(square.timed);

    // A circle turned by the golden ratio: C(r) = 2 r up to the gaps, and distances never change.
    const auto next = [](const std::array<double, 1>& x) {
        return std::array<double, 1>{std::remainder(x[0] + golden * turn, turn)};
    };
    const auto circle =
        correlation_dimension(tests::section_series({{"x", "rad", true}}, {tests::iterate<1>(next, {0.3}, 20000)}));
    CHECK_THAT(circle.dimension, WithinAbs(1.0, 0.05));
    CHECK_THAT(circle.entropy, WithinAbs(0.0, 1e-3));
}

TEST_CASE("correlation dimension of the Henon attractor", "[orbits][correlation]") {
    const auto henon = correlation_dimension(tests::henon_series(60000));
    // 1.220 in the literature.
    CHECK_THAT(henon.dimension, WithinAbs(1.22, 0.02));
    CHECK(henon.sd < 0.02);
    CHECK_THAT(henon.takens, WithinAbs(1.22, 0.05));
    // Grassberger and Procaccia 1983: 0.325 +- 0.02; never above the exponent.
    CHECK_THAT(henon.entropy, WithinAbs(0.325, 0.03));
    CHECK(henon.entropy < 0.41922);
    CHECK(henon.largest_radius <= 0.1);
    CHECK(henon.smallest_radius < 1e-3);

    // Reading errors fill the plane below their size: the range above it is taken.
    auto rough = tests::henon_series(60000);
    std::mt19937_64 random(2);
    std::normal_distribution<double> normal(0.0, 0.001);
    for (Eigen::Index i = 0; i < 60000; ++i) {
        rough.segments[0].values(0, i) += 2.5 * normal(random);
        rough.segments[0].values(1, i) += 0.75 * normal(random);
    }
    const auto noisy = correlation_dimension(rough);
    CHECK_THAT(noisy.dimension, WithinAbs(1.22, 0.05));
    REQUIRE(noisy.remarks.size() == 1);
    CHECK_THAT(noisy.remarks[0], tests::ContainsSubstring("reading errors"));
}

TEST_CASE("logistic map at 4: slopes creep up to 1", "[orbits][correlation]") {
    // The density's corners 1 / sqrt x give C(r) ~ r ln(1 / r): slopes 1 - 1 / ln(a / r).
    const auto line = correlation_dimension(logistic_series(20000));
    // 20 000 points: measured 0.88, with 100 000 0.95.
    CHECK_THAT(line.dimension, WithinAbs(1.0, 0.15));
    CHECK(line.dimension < 1.0);
    REQUIRE(line.scales.size() > 20);
    CHECK(line.scales[20].slope > line.scales[10].slope);
    CHECK(line.scales[10].slope > line.scales[2].slope);
    CHECK_THAT(line.entropy, WithinAbs(std::numbers::ln2, 0.05));
}

TEST_CASE("rounded readings end the radii above their step", "[orbits][correlation]") {
    auto series = logistic_series(20000);
    series.segments[0].values = (series.segments[0].values * 256.0).array().round() / 256.0;
    const auto rounded = correlation_dimension(series);
    REQUIRE_FALSE(rounded.remarks.empty());
    CHECK_THAT(rounded.remarks[0], tests::ContainsSubstring("rounded readings"));
    CHECK(rounded.scales.back().radius > 1.0 / 256.0);
}

TEST_CASE("correlation dimensions refuse what they cannot mean", "[orbits][correlation]") {
    CHECK_THROWS_WITH(correlation_dimension(tests::henon_series(900)), tests::ContainsSubstring("at least 1000"));
    const auto series = tests::henon_series(2000);
    CHECK_THROWS_WITH(correlation_dimension(series, {.pairs = 10}), tests::ContainsSubstring("pairs must be in"));
    CHECK_THROWS_WITH(correlation_dimension(series, {.points = 10}),
                      tests::ContainsSubstring("points must be at least"));
    auto constant = series;
    constant.segments[0].values.setConstant(1.0);
    CHECK_THROWS_AS(correlation_dimension(constant), orbits::DataError);
}

TEST_CASE("invariants of a series with its cycles", "[orbits][correlation]") {
    const auto series = tests::henon_series(10000);
    orbits::CycleSearch search;
    orbits::Cycle fixed, two;
    fixed.period = 1;
    fixed.multipliers = {-1.92373885815340712, 0.1559463223};
    two.period = 2;
    two.multipliers = {-3.01010066774027049, -0.02989933226};
    search.cycles = {fixed, two};
    orbits::InvariantOptions options;
    options.lyapunov.steps = 4000;
    options.correlation.pairs = 100'000;
    auto invariants = orbits::find_invariants(series, search, options);
    CHECK_FALSE(invariants.expansion);
    CHECK_THAT(invariants.expansion_refused, tests::ContainsSubstring("not stated"));
    CHECK_THAT(invariants.lyapunov.exponents[0], WithinAbs(0.419, 0.02));
    CHECK_THAT(invariants.correlation.dimension, WithinAbs(1.22, 0.05));
    options.expansion.complete_to = 2;
    invariants = orbits::find_invariants(series, search, options);
    REQUIRE(invariants.expansion);
    CHECK(invariants.expansion_refused.empty());
    // Two periods only: far from 0.41922.
    CHECK_THAT(invariants.expansion->answer().exponents[0], WithinAbs(0.605945, 1e-6));
    search.cycles.erase(search.cycles.begin());
    invariants = orbits::find_invariants(series, search, options);
    CHECK_FALSE(invariants.expansion);
    CHECK_THAT(invariants.expansion_refused, tests::ContainsSubstring("not complete"));
    options.expansion.complete_to = 65;
    CHECK_THROWS_AS(orbits::find_invariants(series, search, options), std::invalid_argument);
}

}  // namespace correlation_dimension_test
