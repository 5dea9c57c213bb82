#include <tbb/global_control.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>
#include <random>

#include "models/catalogue/registry.hpp"
#include "orbits/cycles/cycle_search.hpp"
#include "orbits/local_maps/reference_map.hpp"
#include "tests/catch.hpp"
#include "tests/orbits/cycles/true_cycles.hpp"
#include "tests/orbits/sections/map_series.hpp"
#include "tests/source_folder.hpp"

namespace closest_return_test {

using namespace orbid;
using Eigen::Index;
using Eigen::Matrix2d;
using Eigen::MatrixXd;
using Eigen::Vector2d;
using Eigen::VectorXd;
using orbits::Cycle;
using orbits::CycleSearchOptions;
using tests::ContainsSubstring;

namespace {

CycleSearchOptions closest_return() {
    CycleSearchOptions options;
    options.method = CycleSearchOptions::Method::closest_return;
    options.box = 0.01;
    options.minimum_recurrences = 3;
    return options;
}

std::size_t count_of(const orbits::CycleSearch& search, int period) {
    return static_cast<std::size_t>(std::count_if(search.cycles.begin(), search.cycles.end(),
                                                  [period](const Cycle& cycle) { return cycle.period == period; }));
}

void shuffle(orbits::Series& series, std::uint32_t seed) {
    std::mt19937_64 random(seed);
    for (auto& segment : series.segments)
        for (Index i = segment.values.cols() - 1; i > 0; --i)
            segment.values.col(i).swap(
                segment.values.col(static_cast<Index>(random() % (static_cast<std::uint64_t>(i) + 1))));
}

// A saddle of period 2: x_0 -> x_1 by B about its points, x_1 -> x_0 by C.
const Vector2d saddle_0(0.2, -0.1), saddle_1(2.0, 1.0);
const Matrix2d gain_b = (Matrix2d() << 2.0, 0.5, -0.3, 0.4).finished();
const Matrix2d gain_c = (Matrix2d() << -1.5, 0.2, 0.6, 0.3).finished();

// 400 pieces of three points that start within 0.4 of x_0 in each coordinate, read with errors of covariance `sigma`.
orbits::Series saddle_series(const Matrix2d& sigma, std::mt19937_64& random) {
    std::uniform_real_distribution<double> place(-0.4, 0.4);
    std::normal_distribution<double> normal;
    const Matrix2d root = sigma.llt().matrixL();
    // One after the other: the order of a call's arguments is the compiler's.
    const auto pair = [&random](auto& law) {
        Vector2d drawn;
        drawn[0] = law(random);
        drawn[1] = law(random);
        return drawn;
    };
    std::vector<MatrixXd> pieces;
    for (int i = 0; i < 400; ++i) {
        MatrixXd piece(2, 3);
        piece.col(0) = saddle_0 + pair(place);
        piece.col(1) = saddle_1 + gain_b * (piece.col(0) - saddle_0);
        piece.col(2) = saddle_0 + gain_c * (piece.col(1) - saddle_1);
        for (Index j = 0; j < 3; ++j)
            piece.col(j) += root * pair(normal);
        pieces.push_back(piece);
    }
    return tests::section_series({{"x", "", false}, {"y", "", false}}, pieces);
}

}  // namespace

TEST_CASE("a map relative to a point of the series is exact where the map is linear", "[orbits][cycles]") {
    std::mt19937_64 random(3);
    const orbits::Series series = saddle_series(Matrix2d::Identity() * 1e-30, random);
    const orbits::SectionPoints section(series);
    const orbits::NeighbourIndex grid(section);
    const orbits::ReferenceMap map = orbits::fit_reference_map(section, grid, 3, 0.1, 32);
    REQUIRE(map.usable);
    CHECK(map.offsets.rows() == 32);
    const MatrixXd unit = section.scale().asDiagonal();
    // Coordinates of order one, offsets of order 0.05, 32 of them: some 20 units of rounding.
    CHECK((map.jacobian - unit.inverse() * gain_b * unit).norm() < 1e-13);
    CHECK(map.residual < 1e-14);
    CHECK(map.curved_residual < 1e-14);
    CHECK(map.image_spread > 0.01);
    for (Index i = 0; i < map.offsets.rows(); ++i) {
        CHECK(map.offsets.row(i).norm() > 0.0);  // not the reference itself
        CHECK(map.offsets.row(i).norm() <= 0.1);
        if (i > 0) CHECK(map.offsets.row(i - 1).norm() <= map.offsets.row(i).norm());
    }
    // The ball limits their number too; two slopes need four neighbours.
    const auto narrow = orbits::fit_reference_map(section, grid, 3, 0.03, 32);
    CHECK(narrow.offsets.rows() < 32);
    CHECK_FALSE(orbits::fit_reference_map(section, grid, 3, 1e-4, 32).usable);
}

TEST_CASE("the closest return's covariance is (M6), and so is the scatter of its estimates", "[orbits][cycles]") {
    const Matrix2d sigma = 1e-6 * (Matrix2d() << 4.0, -1.5, -1.5, 1.0).finished();
    const bool given = GENERATE(true, false);
    CAPTURE(given);
    // What is estimated is of equal size in all coordinates, in units of their ranges.
    const Matrix2d used = given ? sigma : Matrix2d(Vector2d(4e-6, 1e-6).asDiagonal());

    // Readings e_0, e_1, e_2 of the piece: x_0 = (I - CB)^-1 (e_2 - CB e_0), x_1 = e_1 + B (I - CB)^-1 (e_2 - e_0).
    const Matrix2d product = gain_c * gain_b, inverse = (Matrix2d::Identity() - product).inverse();
    MatrixXd gain = MatrixXd::Zero(4, 6);
    gain.topLeftCorner(2, 2) = -inverse * product;
    gain.topRightCorner(2, 2) = inverse;
    gain.bottomLeftCorner(2, 2) = -gain_b * inverse;
    gain.block(2, 2, 2, 2).setIdentity();
    gain.bottomRightCorner(2, 2) = gain_b * inverse;
    MatrixXd readings = MatrixXd::Zero(6, 6);
    for (Index j = 0; j < 3; ++j)
        readings.block(2 * j, 2 * j, 2, 2) = used;
    const MatrixXd exact = gain * readings * gain.transpose();

    CycleSearchOptions options = closest_return();
    options.periods = {2};
    options.box = 0.08;
    options.minimum_recurrences = 1;
    if (given) options.reading_covariance = sigma;
    std::mt19937_64 random(17);
    constexpr int repetitions = 160;
    double chi2 = 0.0, ratio = 0.0, ln_chi2 = 0.0;
    int found = 0;
    const double ln_multiplier = std::log(std::abs(product.eigenvalues().cwiseAbs().maxCoeff()));
    for (int i = 0; i < repetitions; ++i) {
        const auto search = find_cycles(saddle_series(used, random), options);
        if (search.cycles.size() != 1) continue;
        ++found;
        const Cycle& cycle = search.cycles[0];
        VectorXd error(4);
        error << cycle.points.col(0) - saddle_0, cycle.points.col(1) - saddle_1;
        chi2 += error.dot(cycle.covariance.llt().solve(error)) / 4.0;
        ratio += (cycle.covariance * exact.inverse()).trace() / 4.0;
        ln_chi2 += std::pow(cycle.ln_multiplier[0] - ln_multiplier, 2) / cycle.ln_multiplier_covariance(0, 0);
    }
    REQUIRE(found >= 150);
    INFO("chi2 / n " << chi2 / found << ", covariance / exact " << ratio / found << ", ln " << ln_chi2 / found);
    // Errors of the slopes, some 2e-3 / 0.1 / sqrt(32), times the offset from the reference, up to 0.05, are added to
    // the readings': some per cent. Four standard deviations of the mean of 4 x 160 squares are 0.22.
    CHECK(chi2 / found > 0.75);
    CHECK(chi2 / found < 1.25);
    CHECK(ratio / found > 0.95);
    CHECK(ratio / found < 1.15);
    CHECK(ln_chi2 / found > 0.3);
    CHECK(ln_chi2 / found < 1.5);
}

TEST_CASE("the closest return finds all Henon cycles to period 8 and no other", "[orbits][cycles]") {
    std::ifstream file(orbid::tests::source_folder() + "/tests/reference/henon_cycles.json");
    const nlohmann::json reference = nlohmann::json::parse(file);
    CycleSearchOptions options = closest_return();
    options.periods = {1, 2, 3, 4, 5, 6, 7, 8};
    const auto series = tests::henon_series(1 << 16);
    const auto search = find_cycles(series, options);
    const std::vector<std::size_t> expected{1, 1, 0, 1, 0, 2, 4, 7};
    for (int period = 1; period <= 8; ++period) {
        CAPTURE(period);
        CHECK(count_of(search, period) == expected[static_cast<std::size_t>(period - 1)]);
    }
    CHECK(search.missing == std::vector<int>{3, 5});
    double worst = 0.0, worst_multiplier = 0.0, sum = 0.0;
    Index count = 0;
    for (const Cycle& cycle : search.cycles) {
        CHECK(Eigen::LLT<MatrixXd>(cycle.covariance).info() == Eigen::Success);
        double best = std::numeric_limits<double>::infinity(), multiplier = 0.0;
        VectorXd error;
        for (const auto& entry : reference["cycles"]) {
            if (entry["period"] != cycle.period) continue;
            const std::vector<double> x = entry["x_along_orbit"];
            for (std::size_t shift = 0; shift < x.size(); ++shift) {
                VectorXd difference(2 * cycle.period);
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
        worst = std::max(worst, best);
        worst_multiplier = std::max(worst_multiplier, std::abs(cycle.multipliers[0].real() / multiplier - 1.0));
        sum += error.cwiseQuotient(cycle.covariance.diagonal().cwiseSqrt()).squaredNorm();
        count += error.size();
    }
    const double rms = std::sqrt(sum / static_cast<double>(count));
    INFO("worst " << worst << ", multiplier " << worst_multiplier << ", error / sd rms " << rms);
    // Measured 4.4e-5 and 0.032.
    CHECK(worst < 4.4e-4);
    CHECK(worst_multiplier < 0.32);
    CHECK(rms < 1.5);
    CHECK(rms > 0.1);
}

TEST_CASE("the closest return tells how long a cycle takes", "[orbits][cycles]") {
    // Return times that are linear in the state are exact at the cycle's points, wherever the reference lies.
    const auto return_time = [](const auto& x) { return 1.0 + 0.1 * x[0] - 0.05 * x[1]; };
    orbits::Series series = tests::henon_series(1 << 14);
    auto& segment = series.segments[0];
    segment.times.resize(segment.values.cols());
    segment.times[0] = 0.0;
    for (Index i = 1; i < segment.values.cols(); ++i)
        segment.times[i] = segment.times[i - 1] + return_time(Vector2d(segment.values.col(i - 1)));
    CycleSearchOptions options = closest_return();
    options.periods = {1, 2, 4};
    const auto search = find_cycles(series, options);
    REQUIRE(search.cycles.size() == 3);
    for (const Cycle& cycle : search.cycles) {
        double expected = 0.0;
        for (Index j = 0; j < cycle.points.cols(); ++j)
            expected += return_time(Vector2d(cycle.points.col(j)));
        // Times up to 1.7e4 s: differences of their roundings, 4e-12 each.
        CHECK(std::abs(cycle.time - expected) < 1e-10);
        CHECK(cycle.time_sd > 0.0);
        CHECK(cycle.time_sd < 1e-3);
    }
    CHECK(std::isnan(find_cycles(tests::henon_series(1 << 14), options).cycles[0].time));
}

TEST_CASE("the closest return finds true cycles of the pendulum only", "[orbits][cycles][pendulum]") {
    const auto pendulum = models::make_system("parametric_pendulum");
    CycleSearchOptions options = closest_return();
    options.symmetry_signs = pendulum->symmetry()->signs;
    options.minimum_recurrences = 1;
    const auto series = tests::pendulum_record(*pendulum, 1 << 17, 0.0, 1);
    const auto search = find_cycles(series, options);
    const auto truths =
        tests::true_cycles(*pendulum, tests::pendulum_at(*pendulum, 0.0), search.cycles, tests::pendulum_range());
    const tests::TruthSummary all = tests::summary(search.cycles, truths, 0);
    INFO("found " << all.found << ", true " << all.true_ones << ", position " << all.median_position << " / "
                  << all.worst_position << ", multiplier " << all.median_multiplier << ", z " << all.z_rms << " / "
                  << all.z_largest);
    // Measured 72 (periods 1 and 2: 4 and 5), median 1.1e-4, worst 1.1e-3, error / sd 0.45 rms and 1.8 at most.
    CHECK(all.true_ones == all.found);
    CHECK(all.found >= 60);
    CHECK(all.median_position < 1.1e-3);
    CHECK(all.z_rms > 0.2);
    CHECK(all.z_rms < 1.2);
    CHECK(all.z_largest < 4.0);

    const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
    const auto alone = find_cycles(series, options);
    REQUIRE(alone.cycles.size() == search.cycles.size());
    for (std::size_t i = 0; i < alone.cycles.size(); ++i) {
        CHECK(alone.cycles[i].points == search.cycles[i].points);
        CHECK(alone.cycles[i].covariance == search.cycles[i].covariance);
    }
}

TEST_CASE("the closest return finds no cycle in shuffled points", "[orbits][cycles]") {
    const auto pendulum = models::make_system("parametric_pendulum");
    CycleSearchOptions options = closest_return();
    options.minimum_recurrences = 1;
    std::size_t candidates = 0;
    for (const double noise : {0.0, 5e-3})
        for (const bool symmetric : {true, false}) {
            auto series = tests::pendulum_record(*pendulum, 1 << 16, noise, 2);
            shuffle(series, 5);
            options.symmetry_signs.reset();
            if (symmetric) options.symmetry_signs = pendulum->symmetry()->signs;
            const auto search = find_cycles(series, options);
            CHECK(search.cycles.empty());
            candidates += search.candidates;
        }
    CHECK(candidates > 1000);
}

TEST_CASE("the closest return refuses what is not the paper's", "[orbits][cycles]") {
    const auto series = tests::henon_series(400);
    CycleSearchOptions options = closest_return();
    options.order = 2;
    CHECK_THROWS_WITH(find_cycles(series, options), ContainsSubstring("order must be 1 or 0, got 2"));
    options.order = 1;
    options.neighbours = 3;
    CHECK_THROWS_WITH(find_cycles(series, options), ContainsSubstring("neighbours must be at least 4"));
    options.neighbours = 0;
    CHECK_NOTHROW(find_cycles(series, options));
    CHECK_THROWS_WITH(find_cycles(tests::henon_series(300), options), ContainsSubstring("at least 10 x neighbours"));
    options.reading_covariance = MatrixXd::Identity(3, 3);
    CHECK_THROWS_WITH(find_cycles(series, options), ContainsSubstring("reading_covariance has shape (3, 3)"));
}

}  // namespace closest_return_test
