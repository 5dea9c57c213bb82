// The pieces of the patch map against closed forms and dense algebra.
#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <cmath>
#include <random>

#include "orbits/spline_map/reading_smoother.hpp"
#include "orbits/spline_map/section_lift.hpp"
#include "orbits/spline_map/spline_basis.hpp"
#include "orbits/spline_map/tiled_cholesky.hpp"
#include "tests/catch.hpp"
#include "tests/orbits/sections/map_series.hpp"

namespace spline_map_test {

using namespace orbid;
using orbits::SmallMatrix;

TEST_CASE("a tiled factor solves and inverts what a plain one does", "[orbits][patch_map]") {
    std::mt19937_64 random(1);
    std::normal_distribution<double> normal;
    for (const Eigen::Index size : {1, 5, 64, 150}) {
        CAPTURE(size);
        const Eigen::MatrixXd a = Eigen::MatrixXd::NullaryExpr(size, size, [&] { return normal(random); });
        const Eigen::MatrixXd matrix =
            a * a.transpose() + static_cast<double>(size) * Eigen::MatrixXd::Identity(size, size);
        const orbits::TiledCholesky factor({matrix.data(), matrix.data() + matrix.size()},
                                           static_cast<std::size_t>(size));
        REQUIRE(factor.positive_definite());
        const Eigen::VectorXd right = Eigen::VectorXd::NullaryExpr(size, [&] { return normal(random); });
        Eigen::VectorXd solution = right;
        factor.solve(solution.data());
        // condition below 10: rounding of 150 terms, times ten
        CHECK((matrix * solution - right).norm() < 1e-11 * right.norm());
        const std::vector<double> root = factor.inverse_factor();
        const Eigen::Map<const Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>> k(root.data(),
                                                                                                         size, size);
        CHECK((k.transpose() * k * matrix - Eigen::MatrixXd::Identity(size, size)).norm() < 1e-11);
    }
    CHECK_FALSE(orbits::TiledCholesky({1.0, 2.0, 2.0, 1.0}, 2).positive_definite());
}

TEST_CASE("patches sum to one, have the slopes they say and share coefficients with their images",
          "[orbits][patch_map]") {
    const orbits::Series series = tests::standard_map_series(3000);
    const orbits::SectionPoints section(series, std::vector<double>{-1.0, -1.0});
    const Eigen::Map<const Eigen::MatrixXd> places(section.point(0), 2, static_cast<Eigen::Index>(section.size()));
    const orbits::SplineBasis basis(section, places, 0.1);
    orbits::SplineSupport here, there, mirrored;
    for (Eigen::Index i = 0; i < 20; ++i) {
        const Eigen::VectorXd x = places.col(7 * i);
        basis.support(x.data(), 2, here);
        REQUIRE(here.inside);
        CHECK(here.patch.size() == 16);
        CHECK(std::abs(here.value.sum() - 1.0) < 1e-14);
        CHECK(here.slope.rowwise().sum().norm() < 1e-12);
        for (Eigen::Index d = 0; d < 2; ++d) {
            constexpr double step = 1e-6;
            Eigen::VectorXd moved = x;
            moved[d] += step;
            basis.support(moved.data(), 1, there);
            if (there.patch != here.patch) continue;  // another cell
            // differences: second (third) derivatives of at most 2 / h^2 (6 / h^3) times the step
            CHECK(((there.value - here.value) / step - here.slope.row(d).transpose()).norm() < 1e-2);
            for (std::size_t f = 0; f < here.patch.size(); ++f) {
                const auto column = static_cast<Eigen::Index>(f);
                CHECK(((there.slope - here.slope).col(column) / step - here.bending[f].col(d)).norm() < 0.1);
            }
        }
        const Eigen::VectorXd image = -x;
        basis.support(image.data(), 0, mirrored);
        REQUIRE(mirrored.inside);
        for (std::size_t f = 0; f < here.patch.size(); ++f) {
            double same = 0.0;
            for (std::size_t g = 0; g < mirrored.patch.size(); ++g)
                if (mirrored.patch[g] == here.patch[f]) same += mirrored.value[static_cast<Eigen::Index>(g)];
            double own = 0.0;
            for (std::size_t g = 0; g < here.patch.size(); ++g)
                if (here.patch[g] == here.patch[f]) own += here.value[static_cast<Eigen::Index>(g)];
            CHECK(std::abs(same - own) < 1e-13);
        }
    }
    CHECK_THROWS_AS(orbits::SplineBasis(section, places, 0.0), std::invalid_argument);
}

TEST_CASE("errors in both sides of a series are those of the whole covariance", "[orbits][patch_map]") {
    std::mt19937_64 random(3);
    std::normal_distribution<double> normal;
    const Eigen::Index n = 2, steps = 6;
    Eigen::MatrixXd reading(2, 2);
    reading << 1.0, 0.3, 0.3, 0.5;
    std::vector<orbits::SeriesStep> series(static_cast<std::size_t>(steps) + 1);
    Eigen::MatrixXd residual = Eigen::MatrixXd::Zero(n, steps + 1);
    for (Eigen::Index t = 0; t < steps; ++t) {
        orbits::SeriesStep& step = series[static_cast<std::size_t>(t)];
        step.present = true;
        step.jacobian = Eigen::MatrixXd::NullaryExpr(n, n, [&] { return 2.0 * normal(random); });
        step.model = 0.04 * Eigen::MatrixXd::Identity(n, n);
        residual.col(t) = Eigen::VectorXd::NullaryExpr(n, [&] { return normal(random); });
        step.residual = residual.col(t);
    }
    // r = M e + w with the readings' errors e of all points
    Eigen::MatrixXd m = Eigen::MatrixXd::Zero(n * steps, n * (steps + 1));
    for (Eigen::Index t = 0; t < steps; ++t) {
        m.block(n * t, n * t, n, n) = -series[static_cast<std::size_t>(t)].jacobian;
        m.block(n * t, n * (t + 1), n, n) = Eigen::MatrixXd::Identity(n, n);
    }
    Eigen::MatrixXd s = Eigen::MatrixXd::Zero(n * (steps + 1), n * (steps + 1));
    for (Eigen::Index t = 0; t <= steps; ++t)
        s.block(n * t, n * t, n, n) = reading;
    const Eigen::MatrixXd v = m * s * m.transpose() + 0.04 * Eigen::MatrixXd::Identity(n * steps, n * steps);
    const Eigen::MatrixXd inverse = v.inverse();
    const Eigen::VectorXd r = Eigen::Map<const Eigen::VectorXd>(residual.data(), n * steps);
    const Eigen::VectorXd errors = s * m.transpose() * inverse * r;
    const Eigen::MatrixXd remaining = s - s * m.transpose() * inverse * m * s;

    const orbits::ReadingSmoother smoother(series, reading, 1e9);
    CHECK(smoother.gated() == 0);
    const Eigen::MatrixXd weighted = smoother.weighted(residual);
    const Eigen::MatrixXd found = smoother.reading_errors(weighted);
    // matrices of condition 1e3: rounding of 1e-13, times ten
    for (Eigen::Index t = 0; t <= steps; ++t) {
        CAPTURE(t);
        CHECK((found.col(t) - errors.segment(n * t, n)).norm() < 1e-11);
        CHECK((Eigen::MatrixXd(smoother.remaining_covariance(static_cast<std::size_t>(t))) -
               remaining.block(n * t, n * t, n, n))
                  .norm() < 1e-11);
    }
    std::vector<SmallMatrix> row;
    smoother.inverse_row(1, row);
    for (std::size_t k = 0; k < row.size(); ++k)
        CHECK((Eigen::MatrixXd(row[k]) - inverse.block(n, n + n * static_cast<Eigen::Index>(k), n, n)).norm() < 1e-11);

    // an outlier loses its pull and lies at the gate then
    series[2].residual = Eigen::VectorXd::Constant(n, 1e3);
    CHECK(orbits::ReadingSmoother(series, reading, 25.0).gated() >= 1);
}

TEST_CASE("an angle is lifted to what the map did before its turns were lost", "[orbits][patch_map]") {
    // A twist of three turns over the section, on points without dynamics between them: one pair per segment.
    std::mt19937_64 random(5);
    std::uniform_real_distribution<double> uniform(-0.5, 0.5);
    constexpr double turn = 2.0 * std::numbers::pi;
    std::vector<Eigen::MatrixXd> segments;
    std::vector<double> expected;
    for (int i = 0; i < 4000; ++i) {
        const double x = uniform(random), y = uniform(random);
        const double displacement = 3.0 * y + 0.3 * std::sin(turn * x);
        Eigen::MatrixXd pair(2, 2);
        pair << turn * x, std::remainder(turn * (x + displacement), turn), y, 0.9 * y;
        segments.push_back(pair);
        expected.push_back(displacement);
    }
    const orbits::Series series = tests::section_series({{"x", "rad", true}, {"y", "", false}}, segments);
    for (const bool symmetric : {false, true}) {
        CAPTURE(symmetric);
        const orbits::SectionPoints section(
            series, symmetric ? std::optional<std::vector<double>>({-1.0, -1.0}) : std::nullopt);
        const orbits::SectionLift lift = lift_section(section, orbits::NeighbourIndex(section));
        // up to one number of turns for the whole section
        const double shift = std::nearbyint(lift.displacement(0, 0) - expected[0]);
        double largest = 0.0;
        for (std::size_t i = 0; i < expected.size(); ++i)
            largest = std::max(largest,
                               std::abs(lift.displacement(0, static_cast<Eigen::Index>(2 * i)) - shift - expected[i]));
        CHECK(largest < 1e-9);
        if (symmetric) CHECK(lift.offset[0] == shift);
    }
}

}  // namespace spline_map_test
