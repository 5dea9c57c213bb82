// Errors of readings told from a series, against the errors that were put in.
#include "orbits/local_maps/noise_level.hpp"

#include <tbb/global_control.h>

#include <Eigen/Cholesky>
#include <cmath>
#include <numbers>

#include "models/catalogue/registry.hpp"
#include "tests/catch.hpp"
#include "tests/orbits/cycles/measured_cycles.hpp"
#include "tests/orbits/cycles/true_cycles.hpp"
#include "tests/orbits/sections/map_series.hpp"

namespace noise_level_test {

using namespace orbid;
using orbits::NoiseLevel;
using tests::ContainsSubstring;

namespace {

orbits::Series with_errors(orbits::Series series, const Eigen::MatrixXd& covariance, std::uint64_t seed) {
    tests::NormalNumbers normal(seed);
    const Eigen::MatrixXd root = Eigen::LLT<Eigen::MatrixXd>(covariance).matrixL();
    for (orbits::Segment& segment : series.segments)
        for (Eigen::Index i = 0; i < segment.values.cols(); ++i) {
            Eigen::VectorXd z(covariance.rows());
            for (Eigen::Index d = 0; d < z.size(); ++d)
                z[d] = normal();
            segment.values.col(i) += root * z;
        }
    return series;
}

NoiseLevel level_of(const orbits::Series& series, const std::optional<std::vector<double>>& signs = std::nullopt) {
    const orbits::SectionPoints points(series, signs);
    return noise_level(points, orbits::NeighbourIndex(points));
}

// Variances within 4 of their standard errors and 8 % (4 % of an sd: what the curvature of the maps costs, measured up
// to 6 %), correlation within 0.15 (measured up to 0.07).
void check_close(const NoiseLevel& level, const Eigen::MatrixXd& truth) {
    CHECK(level.resolved);
    const Eigen::VectorXd sd = truth.diagonal().cwiseSqrt(), found = level.covariance.diagonal().cwiseSqrt();
    for (Eigen::Index d = 0; d < sd.size(); ++d) {
        CAPTURE(d, sd[d], found[d], level.relative_error[d]);
        CHECK(level.relative_error[d] < 0.2);
        CHECK(std::abs(level.covariance(d, d) / truth(d, d) - 1.0) < 4.0 * level.relative_error[d] + 0.08);
    }
    for (Eigen::Index d = 1; d < sd.size(); ++d) {
        const double correlation = level.covariance(0, d) / (found[0] * found[d]);
        CHECK(std::abs(correlation - truth(0, d) / (sd[0] * sd[d])) < 0.15);
    }
}

}  // namespace

TEST_CASE("the errors of a linear map of two angles come back with their correlation", "[orbits][noise]") {
    // Arnold's cat map, for which S + A S A' is the same everywhere.
    constexpr double turn = 2.0 * std::numbers::pi;
    const auto cat = [](const std::array<double, 2>& x) {
        // A tiny shear keeps rounding from closing the orbit.
        return std::array<double, 2>{std::remainder(2.0 * x[0] + x[1] + 1e-9, turn), std::remainder(x[0] + x[1], turn)};
    };
    const auto series =
        tests::section_series({{"x", "rad", true}, {"y", "rad", true}}, {tests::iterate<2>(cat, {0.3, 0.2}, 20000)});
    Eigen::Matrix2d covariance;
    covariance << 4e-4, -2.5e-4, -2.5e-4, 2.5e-4;
    check_close(level_of(with_errors(series, covariance, 1)), covariance);
}

TEST_CASE("errors of the Henon map at 0.1 % and 0.5 % of the range", "[orbits][noise]") {
    const auto series = tests::henon_series(30000);
    for (const double share : {1e-3, 5e-3}) {
        const Eigen::Vector2d sd(share * 2.57, share * 0.77);
        check_close(level_of(with_errors(series, sd.cwiseAbs2().asDiagonal(), 2)), sd.cwiseAbs2().asDiagonal());
    }
}

TEST_CASE("errors of the pendulum's section, and those of an encoder that share a reading", "[orbits][noise]") {
    const auto system = models::make_system("parametric_pendulum");
    const auto series = tests::pendulum_record(*system, 40000, 0.0, 1);
    const std::vector<double> signs{-1.0, -1.0};
    for (const double share : {1e-4, 5e-3}) {
        const Eigen::VectorXd sd = share * tests::pendulum_range();
        check_close(level_of(with_errors(series, sd.cwiseAbs2().asDiagonal(), 3), signs), sd.cwiseAbs2().asDiagonal());
    }
    const double reading = 2e-5, delay = 0.01508;  // variance [rad^2], [s]
    Eigen::Matrix2d covariance;
    covariance << 1.0, -1.0 / delay, -1.0 / delay, 2.0 / (delay * delay);
    covariance *= reading;
    const NoiseLevel level = level_of(with_errors(series, covariance, 4), signs);
    CHECK(level.resolved);
    CHECK(std::abs(std::sqrt(level.covariance(1, 1) / covariance(1, 1)) - 1.0) < 0.1);
    // The angle's errors hide behind those of the velocity: only their order of magnitude is told.
    CHECK(level.covariance(0, 0) < 4.0 * covariance(0, 0));
    CHECK(level.covariance(0, 1) < 0.0);
}

TEST_CASE("clean series have errors no larger than what the fits leave over, shuffled ones none that are resolved",
          "[orbits][noise]") {
    const auto series = tests::henon_series(20000);
    const NoiseLevel clean = level_of(series);
    CHECK_FALSE(clean.resolved);
    CHECK(std::isnan(clean.relative_error[0]));
    // A quadratic map is fitted exactly: only the ridge of the fits is left (measured 4e-11).
    CHECK(clean.covariance(0, 0) < 1e-18);
    CHECK(clean.covariance(1, 1) > 0.0);

    orbits::Series shuffled = series;
    tests::NormalNumbers uniform(5);
    orbits::Readings& values = shuffled.segments[0].values;
    for (Eigen::Index i = values.cols() - 1; i > 0; --i)
        values.col(i).swap(values.col(static_cast<Eigen::Index>(uniform.uniform() * static_cast<double>(i + 1))));
    CHECK_FALSE(level_of(shuffled).resolved);
}

TEST_CASE("the level is the same with any number of threads, and needs points", "[orbits][noise][threads]") {
    const Eigen::Vector2d sd(2.57e-3, 0.77e-3);
    const auto series = with_errors(tests::henon_series(5000), sd.cwiseAbs2().asDiagonal(), 6);
    const NoiseLevel many = level_of(series);
    const tbb::global_control one_thread(tbb::global_control::max_allowed_parallelism, 1);
    CHECK(level_of(series).covariance == many.covariance);
    CHECK_THROWS_WITH(level_of(tests::henon_series(60)), ContainsSubstring("at least 64 points"));
}

}  // namespace noise_level_test
