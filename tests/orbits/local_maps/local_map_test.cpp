#include "orbits/local_maps/local_map.hpp"

#include <cmath>
#include <memory>
#include <random>

#include "tests/catch.hpp"
#include "tests/orbits/sections/map_series.hpp"

namespace local_map_test {

using namespace orbid;

namespace {

// Neighbourhood of radius r around a centre, images from a function, without any series.
template <class Map>
orbits::Neighbourhood sampled(const Map& map, const Eigen::Vector2d& centre, double r, int k) {
    std::mt19937_64 random(11);
    std::uniform_real_distribution<double> uniform(-0.7, 0.7);
    orbits::Neighbourhood result;
    result.centre = centre;
    result.reference = Eigen::Vector2d::Zero();
    result.radius = r;
    result.offsets.resize(k, 2);
    result.images.resize(k, 2);
    for (int i = 0; i < k; ++i) {
        const Eigen::Vector2d d(r * uniform(random), r * uniform(random));
        result.offsets.row(i) = d.transpose();
        result.images.row(i) = map(centre + d).transpose();
    }
    return result;
}

orbits::LocalMap fitted(const orbits::SectionPoints& points, const orbits::Neighbourhood& near, int order) {
    orbits::PolynomialFit workspace;
    return orbits::fit_local_map(points, near, order, static_cast<std::size_t>(near.offsets.rows()),
                                 std::make_shared<const orbits::Monomials>(near.centre.size(), order), workspace);
}

const orbits::SectionPoints& plane() {
    static const orbits::SectionPoints points(tests::henon_series(100));
    return points;
}

Eigen::Vector2d wavy(const Eigen::Vector2d& x) {
    return {0.2 * std::sin(3.0 * x[0] + x[1]), 0.1 * std::exp(x[0] - 2.0 * x[1])};
}

Eigen::Matrix2d wavy_jacobian(const Eigen::Vector2d& x) {
    const double c = 0.2 * std::cos(3.0 * x[0] + x[1]), e = 0.1 * std::exp(x[0] - 2.0 * x[1]);
    return Eigen::Matrix2d{{3.0 * c, c}, {e, -2.0 * e}};
}

}  // namespace

TEST_CASE("quadratic fit of a quadratic map is exact", "[orbits][local_map]") {
    const auto map = [](const Eigen::Vector2d& x) {
        return Eigen::Vector2d(0.3 + x[0] - 2.0 * x[1] + 3.0 * x[0] * x[0] - x[0] * x[1],
                               0.1 - x[1] + 4.0 * x[1] * x[1]);
    };
    const Eigen::Vector2d centre(0.1, -0.05);
    const auto fit = fitted(plane(), sampled(map, centre, 0.01, 32), 2);
    REQUIRE(fit.usable);
    // Rounding 1e-16 over radius 1e-2, its square and the design's condition of about ten; bounds are ten times that.
    CHECK((fit.value - map(centre)).cwiseAbs().maxCoeff() < 1e-15);
    const Eigen::Matrix2d jacobian{{1.0 + 6.0 * centre[0] - centre[1], -2.0 - centre[0]},
                                   {0.0, -1.0 + 8.0 * centre[1]}};
    CHECK((fit.jacobian - jacobian).cwiseAbs().maxCoeff() < 1e-12);
    const Eigen::Matrix<double, 2, 3> quadratic{{3.0, -1.0, 0.0}, {0.0, 0.0, 4.0}};
    CHECK((fit.coefficients.rightCols(3) / (fit.radius * fit.radius) - quadratic).cwiseAbs().maxCoeff() < 1e-9);
    const Eigen::Vector2d d(0.004, -0.003);
    CHECK((fit.value + fit.displacement(d) - map(centre + d)).cwiseAbs().maxCoeff() < 1e-14);
    CHECK((fit.jacobian_at(d) - fit.jacobian).cwiseAbs().maxCoeff() > 1e-2);
}

TEST_CASE("local fits converge with the radius in their order", "[orbits][local_map]") {
    const Eigen::Vector2d centre(0.2, 0.1);
    for (const int order : {1, 2, 3, 4, 5, 6}) {
        double previous_value = 0.0, previous_jacobian = 0.0;
        // High orders reach rounding in small neighbourhoods.
        for (const double radius : {0.08, 0.04, 0.02, 0.01}) {
            const double r = order < 3 ? radius : 4.0 * radius;
            CAPTURE(order, r);
            const auto fit = fitted(plane(), sampled(wavy, centre, r, 20 * order), order);
            REQUIRE(fit.usable);
            const double value = (fit.value - wavy(centre)).norm();
            const double jacobian = (fit.jacobian - wavy_jacobian(centre)).norm();
            if (previous_value > 0.0 && value > 1e-13) {
                // value O(r^(order + 1)), jacobian O(r^order); the sampling pattern scales with the radius
                CHECK_THAT(std::log2(previous_value / value), tests::WithinAbs(order + 1.0, 0.6));
                CHECK_THAT(std::log2(previous_jacobian / jacobian), tests::WithinAbs(order, 0.6));
            }
            previous_value = value;
            previous_jacobian = jacobian;
        }
    }
}

TEST_CASE("covariance of a local fit matches its errors", "[orbits][local_map]") {
    std::mt19937_64 random(3);
    std::uniform_real_distribution<double> uniform(-1.0, 1.0);
    std::normal_distribution<double> normal;
    for (const double noise : {0.0, 1e-4}) {
        CAPTURE(noise);
        double sum = 0.0;
        int count = 0;
        for (int trial = 0; trial < 300; ++trial) {
            const Eigen::Vector2d centre(uniform(random), uniform(random));
            const auto noisy = [&](const Eigen::Vector2d& x) {
                return Eigen::Vector2d(wavy(x) + noise * Eigen::Vector2d(normal(random), normal(random)));
            };
            const auto neighbourhood = sampled(noisy, centre, 0.03, 32);
            const auto fit = fitted(plane(), neighbourhood, 2);
            const Eigen::MatrixXd covariance = orbits::local_map_covariance(neighbourhood, fit);
            REQUIRE(covariance.rows() == 6);
            Eigen::VectorXd error(6);
            const Eigen::Vector2d exact = wavy(centre);
            const Eigen::Matrix2d exact_jacobian = wavy_jacobian(centre);
            for (Eigen::Index i = 0; i < 2; ++i)
                error[i] = fit.value[i] - exact[i];
            for (Eigen::Index i = 0; i < 4; ++i)
                error[2 + i] = fit.jacobian.data()[i] - exact_jacobian.data()[i];
            for (Eigen::Index i = 0; i < 6; ++i) {
                REQUIRE(covariance(i, i) > 0.0);
                sum += error[i] * error[i] / covariance(i, i);
                ++count;
            }
        }
        // Both models of the residuals are counted in full, so sds may be too large, not too small. Measured rms of
        // error / sd: between 0.40 and 1.04.
        const double rms = std::sqrt(sum / count);
        INFO("rms of error / sd " << rms);
        CHECK(rms < 1.5);
        CHECK(rms > 0.2);
    }
}

TEST_CASE("images on a circle are unwrapped and torn neighbours dropped", "[orbits][local_map]") {
    // theta -> 3 theta: images of a neighbourhood of radius 0.1 turn around 1/6 turn straddle the seam at half a turn.
    constexpr double turn = 2.0 * std::numbers::pi;
    const auto series = tests::section_series(
        {{"theta", "rad", true}},
        {tests::iterate<1>(
            [](const std::array<double, 1>& x) {
                return std::array<double, 1>{std::remainder(3.0 * x[0] + 0.1 * std::sin(x[0]), turn)};
            },
            {0.4}, 2000)});
    const orbits::SectionPoints points(series);
    const orbits::NeighbourIndex grid(points);
    const Eigen::VectorXd centre = Eigen::VectorXd::Constant(1, 1.0 / 6.0);
    const auto whole = orbits::gather_neighbourhood(points, grid, centre, 30);
    CHECK(whole.offsets.rows() == 30);
    const auto fit = fitted(points, whole, 2);
    REQUIRE(fit.usable);
    CHECK_THAT(fit.jacobian(0, 0), tests::WithinAbs(3.0 + 0.1 * std::cos(turn / 6.0), 1e-4));
    const auto torn = orbits::gather_neighbourhood(points, grid, centre, 1000);
    CHECK(torn.offsets.rows() < 500);
    CHECK(torn.images.cwiseAbs().maxCoeff() < 0.25);
}

TEST_CASE("a neighbourhood that cannot carry the fit is not usable", "[orbits][local_map]") {
    const Eigen::Vector2d centre(0.0, 0.0);
    CHECK_FALSE(fitted(plane(), sampled(wavy, centre, 0.01, 7), 2).usable);
    CHECK(fitted(plane(), sampled(wavy, centre, 0.01, 8), 2).usable);
    auto flat = sampled(wavy, centre, 0.01, 32);
    flat.offsets.col(1) = flat.offsets.col(0);
    CHECK_FALSE(fitted(plane(), flat, 1).usable);
}

}  // namespace local_map_test
