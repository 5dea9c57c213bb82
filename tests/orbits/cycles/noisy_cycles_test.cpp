// Cycles of noisy series on one map for the whole section.
#include <Eigen/Eigenvalues>
#include <cmath>
#include <random>

#include "models/catalogue/registry.hpp"
#include "orbits/cycles/cycle_search.hpp"
#include "tests/catch.hpp"
#include "tests/orbits/cycles/true_cycles.hpp"
#include "tests/orbits/sections/map_series.hpp"

namespace noisy_cycles_test {

using namespace orbid;

namespace {

// Henon with normal errors of `noise` times the range.
orbits::Series noisy_henon(Eigen::Index count, double noise) {
    orbits::Series series = tests::henon_series(count);
    const Eigen::VectorXd scale = series.scale();
    std::mt19937_64 random(5);
    std::normal_distribution<double> normal;
    for (Eigen::Index i = 0; i < count; ++i)
        for (Eigen::Index d = 0; d < 2; ++d)
            series.segments[0].values(d, i) += noise * scale[d] * normal(random);
    return series;
}

orbits::CycleSearchOptions search_options(const orbits::Series& series, double noise) {
    orbits::CycleSearchOptions options;
    options.method = orbits::CycleSearchOptions::Method::spline_map;
    options.periods = {1, 2, 3, 4, 5, 6};
    options.reading_covariance = (noise * series.scale()).cwiseAbs2().asDiagonal();
    return options;
}

}  // namespace

TEST_CASE("noisy Henon points hold the map's cycles within their errors", "[orbits][cycles][patch_map]") {
    constexpr double noise = 1e-3;
    const orbits::Series series = noisy_henon(8000, noise);
    const orbits::CycleSearch search = find_cycles(series, search_options(series, noise));
    CHECK(search.spline_map);
    std::vector<int> counts(7, 0);
    double squares = 0.0, values = 0.0;
    for (const orbits::Cycle& cycle : search.cycles) {
        CAPTURE(cycle.period, cycle.points);
        ++counts[static_cast<std::size_t>(cycle.period)];
        // the exact cycle, by Newton's method on x_{j+1} = 1 - 1.4 x_j^2 + 0.3 x_{j-1}
        const int p = cycle.period;
        Eigen::VectorXd x = cycle.points.row(0).transpose();
        for (int step = 0; step < 30; ++step) {
            Eigen::MatrixXd slope = Eigen::MatrixXd::Zero(p, p);
            Eigen::VectorXd defect(p);
            for (int j = 0; j < p; ++j) {
                const int next = (j + 1) % p, before = (j + p - 1) % p;
                defect[j] = 1.0 - 1.4 * x[j] * x[j] + 0.3 * x[before] - x[next];
                slope(j, j) -= 2.8 * x[j];
                slope(j, before) += 0.3;
                slope(j, next) -= 1.0;
            }
            x -= slope.fullPivLu().solve(defect);
        }
        Eigen::Matrix2d product = Eigen::Matrix2d::Identity();
        for (int j = 0; j < p; ++j) {
            Eigen::Matrix2d jacobian;
            jacobian << -2.8 * x[j], 1.0, 0.3, 0.0;
            product = jacobian * product;
        }
        for (int j = 0; j < p; ++j) {
            const double z = (cycle.points(0, j) - x[j]) / std::sqrt(cycle.covariance(2 * j, 2 * j));
            CHECK(std::abs(z) < 5.0);
            squares += z * z;
            values += 1.0;
        }
        const double exact = std::log(product.eigenvalues().cwiseAbs().maxCoeff());
        CHECK(std::abs(cycle.ln_multiplier[0] - exact) < 5.0 * std::sqrt(cycle.ln_multiplier_covariance(0, 0)));
    }
    // All on the attractor: the fixed point, 1, 0, 1, 0, 2.
    CHECK(counts == std::vector<int>{0, 1, 1, 0, 1, 0, 2});
    CHECK(std::sqrt(squares / values) < 2.0);
    CHECK(std::sqrt(squares / values) > 0.2);
}

TEST_CASE("errors that grow to more than half a turn leave the shortest cycles", "[orbits][cycles][patch_map]") {
    // Errors of 2 % of the range grow fortyfold where the pendulum passes upside down. The model has 6 and 9 cycles.
    constexpr double noise = 0.02;
    const auto system = models::make_system("parametric_pendulum");
    const orbits::Series series = tests::pendulum_record(*system, std::size_t{1} << 15, noise, 1);
    orbits::CycleSearchOptions options = search_options(series, noise);
    options.periods = {1, 2};
    options.symmetry_signs = std::vector<double>{-1.0, -1.0};
    options.reading_covariance = (noise * tests::pendulum_range()).cwiseAbs2().asDiagonal();
    const orbits::CycleSearch search = find_cycles(series, options);
    const auto truths =
        tests::true_cycles(*system, tests::pendulum_at(*system, 0.0), search.cycles, tests::pendulum_range());
    const auto fixed = tests::summary(search.cycles, truths, 1);
    CHECK(fixed.true_ones == 6);
    CHECK(fixed.found == 6);
    const auto doubled = tests::summary(search.cycles, truths, 2);
    CAPTURE(doubled.found, doubled.worst_position);
    // Measured 9 of 9; other rounding may lose or add a mirror pair.
    CHECK(doubled.true_ones >= 7);
    CHECK(doubled.found <= doubled.true_ones + 2);
    CHECK(tests::summary(search.cycles, truths, 0).z_rms < 2.0);
}

TEST_CASE("shuffled points hold no cycle, with errors said small or large", "[orbits][cycles][patch_map]") {
    for (const double noise : {1e-3, 5e-2}) {
        CAPTURE(noise);
        orbits::Series series = noisy_henon(4000, noise);
        std::mt19937_64 random(9);
        for (Eigen::Index i = 3999; i > 0; --i)
            series.segments[0].values.col(i).swap(
                series.segments[0].values.col(static_cast<Eigen::Index>(random() % static_cast<std::uint64_t>(i + 1))));
        const orbits::CycleSearch search = find_cycles(series, search_options(series, noise));
        CHECK(search.cycles.empty());
        CHECK_FALSE(search.remarks.empty());
    }
}

}  // namespace noisy_cycles_test
