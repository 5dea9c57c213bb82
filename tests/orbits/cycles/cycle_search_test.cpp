#include "orbits/cycles/cycle_search.hpp"

#include <tbb/global_control.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>
#include <random>

#include "tests/catch.hpp"
#include "tests/orbits/sections/map_series.hpp"
#include "tests/source_folder.hpp"

namespace cycle_search_test {

using namespace orbid;
using orbits::Cycle;
using orbits::CycleSearchOptions;
using tests::ContainsSubstring;
using tests::WithinAbs;
using tests::WithinRel;

namespace {

std::size_t count_of(const orbits::CycleSearch& search, int period) {
    return static_cast<std::size_t>(std::count_if(search.cycles.begin(), search.cycles.end(),
                                                  [period](const Cycle& cycle) { return cycle.period == period; }));
}

bool same(const Cycle& a, const Cycle& b) {
    return a.points == b.points && a.covariance == b.covariance && a.multipliers == b.multipliers &&
           a.ln_multiplier_covariance == b.ln_multiplier_covariance && a.recurrences == b.recurrences &&
           a.mirror == b.mirror && a.rotation == b.rotation;
}

}  // namespace

TEST_CASE("all Henon cycles to period 8 that the series visits are found, and no other", "[orbits][cycles]") {
    std::ifstream file(orbid::tests::source_folder() + "/tests/reference/henon_cycles.json");
    const nlohmann::json reference = nlohmann::json::parse(file);
    CycleSearchOptions options;
    options.periods = {1, 2, 3, 4, 5, 6, 7, 8};
    const auto series = tests::henon_series(1 << 16);
    for (const int order : {0, 1, 2}) {
        CAPTURE(order);
        options.order = order;
        const auto search = find_cycles(series, options);
        // prime_cycle_count of the table; the fixed point at x = -1.13 lies off the attractor
        const std::vector<std::size_t> expected{1, 1, 0, 1, 0, 2, 4, 7};
        for (int period = 1; period <= 8; ++period) {
            CAPTURE(period);
            CHECK(count_of(search, period) == expected[static_cast<std::size_t>(period - 1)]);
        }
        CHECK(search.missing == std::vector<int>{3, 5});
        double sum = 0.0, largest = 0.0;
        int count = 0;
        for (const Cycle& cycle : search.cycles) {
            CHECK(cycle.rotation.empty());
            CHECK(!cycle.mirror.has_value());
            CHECK(Eigen::LLT<Eigen::MatrixXd>(cycle.covariance).info() == Eigen::Success);
            // the constraint x, y = 0.3 x_previous identifies the cycle in the table by its x
            double best = std::numeric_limits<double>::infinity(), multiplier = 0.0;
            Eigen::VectorXd error;
            for (const auto& entry : reference["cycles"]) {
                if (entry["period"] != cycle.period) continue;
                const std::vector<double> x = entry["x_along_orbit"];
                for (std::size_t shift = 0; shift < x.size(); ++shift) {
                    Eigen::VectorXd difference(2 * cycle.period);
                    for (int j = 0; j < cycle.period; ++j) {
                        const std::size_t at = (static_cast<std::size_t>(j) + shift) % x.size();
                        difference[2 * j] = cycle.points(0, j) - x[at];
                        difference[2 * j + 1] = cycle.points(1, j) - 0.3 * x[(at + x.size() - 1) % x.size()];
                    }
                    if (difference.cwiseAbs().maxCoeff() < best) {
                        best = difference.cwiseAbs().maxCoeff();
                        error = difference;
                        multiplier = std::stod(entry["unstable_multiplier"].get<std::string>());
                    }
                }
            }
            CAPTURE(cycle.period, best);
            // Quadratic: the map is quadratic, so only rounding is left (measured 2e-14; the table has 16 digits).
            // Linear: measured 3e-5 at worst.
            CHECK(best < (order != 1 ? 2e-13 : 3e-4));
            CHECK_THAT(cycle.multipliers[0].real(), WithinRel(multiplier, order != 1 ? 1e-8 : 0.1));
            const Eigen::VectorXd z = error.cwiseQuotient(cycle.covariance.diagonal().cwiseSqrt());
            sum += z.squaredNorm();
            count += static_cast<int>(z.size());
            largest = std::max(largest, z.cwiseAbs().maxCoeff());
        }
        INFO("error / sd: rms " << std::sqrt(sum / count) << ", largest " << largest);
        CHECK(std::sqrt(sum / count) < 1.5);
        CHECK(largest < 4.0);
    }
}

TEST_CASE("cycles of the logistic map at 4 have multipliers of modulus 2^p", "[orbits][cycles]") {
    // |multiplier| = 2^p for every cycle but the fixed point 0 (4); prime cycles 2, 1, 2, 3, 6, 9.
    const auto series = tests::section_series(
        {{"x", "", false}},
        {tests::iterate<1>(
            [](const std::array<double, 1>& x) { return std::array<double, 1>{4.0 * x[0] * (1.0 - x[0])}; }, {0.3123},
            1 << 15)});
    CycleSearchOptions options;
    options.periods = {1, 2, 3, 4, 5, 6};
    const auto search = find_cycles(series, options);
    const std::vector<std::size_t> expected{2, 1, 2, 3, 6, 9};
    for (int period = 1; period <= 6; ++period) {
        CAPTURE(period);
        CHECK(count_of(search, period) == expected[static_cast<std::size_t>(period - 1)]);
    }
    for (const Cycle& cycle : search.cycles) {
        const bool origin = cycle.period == 1 && std::abs(cycle.points(0, 0)) < 1e-6;
        // quadratic map, quadratic fits: rounding over the small neighbourhoods (radius 1e-4 and less)
        CHECK_THAT(cycle.ln_multiplier[0], WithinAbs(std::log(2.0) * (origin ? 2.0 : cycle.period), 1e-7));
        CHECK(cycle.ln_multiplier_covariance(0, 0) > 0.0);
    }
}

TEST_CASE("fixed points of the standard map across the seams of two angles", "[orbits][cycles]") {
    // x = y = 0: trace 2 + 7; (pi, 0): 2 - 7; sin x = 2 pi / 7, y = 0: trace 2 + 7 cos x, elliptic for cos x < 0
    // (trace -1.09): the chaotic orbit only comes near, and local maps may or may not reach it. Determinant 1.
    CycleSearchOptions options;
    options.periods = {1};
    options.symmetry_signs = std::vector<double>{-1.0, -1.0};
    const auto search = find_cycles(tests::standard_map_series(1 << 17), options);
    const double side = std::asin(2.0 * std::numbers::pi / 7.0);
    const double elliptic = std::numbers::pi - side;
    int matched = 0, hyperbolic = 0;
    for (std::size_t i = 0; i < search.cycles.size(); ++i) {
        const Cycle& cycle = search.cycles[i];
        const double x = cycle.points(0, 0);
        for (const double exact : {0.0, std::numbers::pi, side, -side, elliptic, -elliptic}) {
            if (!(std::abs(std::remainder(x - exact, 2.0 * std::numbers::pi)) < 1e-3)) continue;
            ++matched;
            CAPTURE(exact);
            if (std::abs(exact) == elliptic) continue;
            ++hyperbolic;
            const double trace = 2.0 + 7.0 * std::cos(exact), half = 0.5 * trace;
            const double large = half + std::copysign(std::sqrt(half * half - 1.0), half);
            // measured 1.3e-6 and 3e-4
            CHECK_THAT(std::remainder(x - exact, 2.0 * std::numbers::pi), WithinAbs(0.0, 1.3e-5));
            CHECK_THAT(cycle.points(1, 0), WithinAbs(0.0, 1.3e-5));
            CHECK_THAT(cycle.multipliers[0].real(), WithinRel(large, 3e-3));
            CHECK_THAT(cycle.multipliers[1].real(), WithinRel(1.0 / large, 3e-3));
            REQUIRE(cycle.mirror.has_value());
            const Cycle& partner = search.cycles[*cycle.mirror];
            const bool symmetric = exact == 0.0 || exact == std::numbers::pi;
            CHECK((*cycle.mirror == i) == symmetric);
            if (!symmetric) CHECK(partner.points == -cycle.points);
            CHECK(partner.mirror == i);
        }
        CHECK(cycle.points(0, 0) > -std::numbers::pi);
        CHECK(cycle.rotation.empty());  // wrapped readings do not tell
    }
    CHECK(hyperbolic == 4);
    CHECK(matched == static_cast<int>(search.cycles.size()));
}

TEST_CASE("orders and neighbours that are asked for are used", "[orbits][cycles]") {
    // Fixed point 0.3117... of a map that is a polynomial of no order; higher orders are more exact.
    const auto next = [](const std::array<double, 1>& x) {
        return std::array<double, 1>{std::sin(3.3 * x[0]) * std::exp(-0.2 * x[0])};
    };
    const auto series = tests::section_series({{"x", "", false}}, {tests::iterate<1>(next, {0.2}, 1 << 12)});
    double fixed = 0.8;
    for (int step = 0; step < 60; ++step) {  // Newton with a difference
        const double h = 1e-6, f = next({fixed})[0] - fixed;
        fixed -= f / ((next({fixed + h})[0] - next({fixed - h})[0]) / (2.0 * h) - 1.0);
    }
    CycleSearchOptions options;
    options.periods = {1};
    options.neighbours = 40;
    double previous = 1.0;
    for (const int order : {1, 2, 4, 6}) {
        CAPTURE(order);
        options.order = order;
        const auto search = find_cycles(series, options);
        double error = 1.0;
        for (const Cycle& cycle : search.cycles)
            error = std::min(error, std::abs(cycle.points(0, 0) - fixed));
        // Every two orders gain the square of radius over range, 1e-4; rounding ends that.
        CHECK(error < std::max(0.1 * previous, 1e-14));
        previous = error;
    }
    options.order = 0;
    options.neighbours = 0;
    CHECK(!find_cycles(series, options).cycles.empty());
}

TEST_CASE("remarks on cycles say what is peculiar about them", "[orbits][cycles]") {
    // Standard map: the fixed points at sin x = 2 pi / 7 with cos x < 0 are elliptic, the chaotic orbit hardly comes
    // near; (pi, 0) and (0, 0) are hyperbolic and visited often.
    CycleSearchOptions options;
    options.periods = {1};
    options.minimum_recurrences = 1;
    const auto search = find_cycles(tests::standard_map_series(1 << 16), options);
    int plain = 0;
    for (const Cycle& cycle : search.cycles) {
        const double modulus = std::abs(cycle.multipliers[0]);
        const bool degenerate = std::any_of(cycle.quality.begin(), cycle.quality.end(), [](const std::string& remark) {
            return remark.find("near-degenerate") != std::string::npos;
        });
        const bool isolated = std::any_of(cycle.quality.begin(), cycle.quality.end(), [](const std::string& remark) {
            return remark.find("isolated") != std::string::npos;
        });
        CAPTURE(modulus, cycle.recurrences);
        if (modulus > 2.0) CHECK(!degenerate);
        if (modulus < 1.02) CHECK(degenerate);
        CHECK(isolated == (cycle.recurrences < 3));
        plain += cycle.quality.empty() ? 1 : 0;
    }
    CHECK(plain >= 2);
}

TEST_CASE("turns are counted when the angle was read without wrapping", "[orbits][cycles]") {
    // theta' = theta + 1 + 6.5 sin theta: fixed up to r turns where sin theta = (2 pi r - 1) / 6.5, multiplier
    // 1 + 6.5 cos theta; r = 0 and 1 only.
    const auto next = [](const std::array<double, 1>& x) {
        return std::array<double, 1>{x[0] + 1.0 + 6.5 * std::sin(x[0])};
    };
    const auto series = tests::section_series({{"theta", "rad", true}}, {tests::iterate<1>(next, {0.2}, 1 << 15)});
    CycleSearchOptions options;
    options.periods = {1};
    const auto search = find_cycles(series, options);
    REQUIRE(search.cycles.size() == 4);
    int turning = 0;
    for (const Cycle& cycle : search.cycles) {
        REQUIRE(cycle.rotation.size() == 1);
        const double theta = cycle.points(0, 0);
        turning += cycle.rotation[0];
        CHECK_THAT(1.0 + 6.5 * std::sin(theta), WithinAbs(2.0 * std::numbers::pi * cycle.rotation[0], 1e-6));
        CHECK_THAT(cycle.multipliers[0].real(), WithinRel(1.0 + 6.5 * std::cos(theta), 1e-3));
    }
    CHECK(turning == 2);
}

TEST_CASE("no pair of points is made across segments or missing samples", "[orbits][cycles]") {
    const auto whole = tests::henon_series(20000);
    const orbits::Readings& values = whole.segments[0].values;
    CycleSearchOptions options;
    options.periods = {1, 2, 4, 6};
    const auto expected = find_cycles(whole, options);

    // The same points with every 50th missing, and cut into pieces in reverse order: fewer pairs, the same cycles. A
    // single false pair in a neighbourhood would spoil the exact quadratic fits.
    Eigen::MatrixXd holes = values;
    for (Eigen::Index i = 0; i < holes.cols(); i += 50)
        holes(1, i) = std::nan("");
    std::vector<Eigen::MatrixXd> pieces;
    for (Eigen::Index i = values.cols() - 40; i >= 0; i -= 40)
        pieces.emplace_back(values.middleCols(i, 40));
    for (const auto& series :
         {tests::section_series(whole.coordinates, {holes}), tests::section_series(whole.coordinates, pieces)}) {
        const auto found = find_cycles(series, options);
        REQUIRE(found.cycles.size() == expected.cycles.size());
        for (const Cycle& cycle : found.cycles) {
            double best = 1.0;
            for (const Cycle& other : expected.cycles) {
                if (other.period != cycle.period) continue;
                for (int shift = 0; shift < cycle.period; ++shift)
                    best = std::min(best, (cycle.points.col(0) - other.points.col(shift)).norm());
            }
            CHECK(best < 1e-12);
        }
    }
}

TEST_CASE("a shuffled series has no cycles", "[orbits][cycles]") {
    std::mt19937_64 random(17);
    for (auto series : {tests::henon_series(1 << 15), tests::standard_map_series(1 << 15)}) {
        orbits::Readings& values = series.segments[0].values;
        for (Eigen::Index i = values.cols() - 1; i > 0; --i)
            values.col(i).swap(values.col(static_cast<Eigen::Index>(random() % static_cast<std::uint64_t>(i + 1))));
        CycleSearchOptions options;
        options.box = 0.1;
        options.minimum_recurrences = 1;
        const auto search = find_cycles(series, options);
        CHECK(search.cycles.empty());
        CHECK(search.missing == options.periods);
        CHECK(search.candidates > 100);  // there were recurrences enough to be fooled by
        REQUIRE(search.remarks.size() == options.periods.size());
        CHECK_THAT(search.remarks[0], tests::ContainsSubstring("no cycle of period 1 was found: of ") &&
                                          tests::ContainsSubstring(" near returns none closed on a cycle"));
        CHECK(search.rejected == search.candidates);
    }
}

TEST_CASE("cycles are the same bytes with any number of threads", "[orbits][cycles][threads]") {
    const auto series = tests::standard_map_series(1 << 16);
    CycleSearchOptions options;
    options.periods = {1, 2, 3};
    options.symmetry_signs = std::vector<double>{-1.0, -1.0};
    std::vector<orbits::CycleSearch> searches;
    for (const std::size_t threads : {1U, 2U, 4U}) {
        const tbb::global_control control(tbb::global_control::max_allowed_parallelism, threads);
        searches.push_back(find_cycles(series, options));
    }
    REQUIRE(!searches[0].cycles.empty());
    for (const auto& search : searches) {
        REQUIRE(search.cycles.size() == searches[0].cycles.size());
        CHECK(search.rejected == searches[0].rejected);
        for (std::size_t i = 0; i < search.cycles.size(); ++i)
            CHECK(same(search.cycles[i], searches[0].cycles[i]));
    }
}

TEST_CASE("find_cycles refuses wrong calls", "[orbits][cycles]") {
    const auto series = tests::henon_series(1000);
    const auto refused = [&](auto change, const orbits::Series& data, const char* text) {
        CycleSearchOptions options;
        change(options);
        CHECK_THROWS_WITH(find_cycles(data, options), ContainsSubstring(text));
    };
    refused([](auto& o) { o.periods = {}; }, series, "periods");
    refused([](auto& o) { o.periods = {0}; }, series, "got 0");
    refused([](auto& o) { o.periods = {65}; }, series, "got 65");
    refused([](auto& o) { o.box = 0.0; }, series, "box");
    refused([](auto& o) { o.box = 0.5; }, series, "box");
    refused([](auto& o) { o.box = std::nan(""); }, series, "box");
    refused([](auto& o) { o.order = 7; }, series, "order must be 1 to 6, or 0 for the data to choose, got 7");
    refused([](auto& o) { o.order = 2, o.neighbours = 7; }, series, "at least 8");
    refused([](auto& o) { o.order = 1, o.neighbours = 4; }, series, "at least 5");
    refused([](auto& o) { o.neighbours = 100; }, series, "1000 points with an image, got 999");
    refused([](auto& o) { o.reading_covariance.setOnes(1, 1); }, series, "reading_covariance has shape (1, 1)");
    refused([](auto& o) { o.partition = orbits::Partition{2, {0.0}, "AB"}; }, series, "must be in [0, 2), got 2");
    refused([](auto& o) { o.partition = orbits::Partition{0, {0.0}, "A"}; }, series, "needs one symbol more, got 1");
    refused([](auto& o) { o.partition = orbits::Partition{0, {0.5, 0.5}, "ABC"}; }, series, "ascending");
    refused([](auto& o) { o.minimum_recurrences = 0; }, series, "minimum_recurrences");
    refused([](auto& o) { o.symmetry_signs = std::vector<double>{-1.0}; }, series, "symmetry_signs");
    refused([](auto& o) { o.symmetry_signs = std::vector<double>{-1.0, 0.5}; }, series, "+1 or -1");
    const auto as_they_are = [](auto&) {};
    auto samples = series;
    samples.sampling = orbits::Series::Sampling::samples;
    refused(as_they_are, samples, "time samples");
    auto constant = series;
    constant.segments[0].values.row(1).setConstant(2.0);
    refused(as_they_are, constant, "'y' has no spread");
    auto ragged = series;
    ragged.segments.push_back({"short", Eigen::MatrixXd::Zero(1, 5), {}});
    refused(as_they_are, ragged, "'short'");
    refused(as_they_are, orbits::Series{}, "no coordinates");
}

}  // namespace cycle_search_test
