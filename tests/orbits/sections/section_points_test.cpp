#include "orbits/sections/section_points.hpp"

#include <cmath>
#include <limits>
#include <numbers>
#include <random>

#include "tests/catch.hpp"
#include "tests/orbits/sections/map_series.hpp"

namespace section_points_test {

using namespace orbid;
using orbits::SectionPoints;
using tests::WithinAbs;

TEST_CASE("points of a section keep readings, images and turns over segments of any length",
          "[orbits][section_points]") {
    // Lengths around words of 64 bits and blocks of 2^14 points, one of them empty; every 13th point missing.
    constexpr double turn = 2.0 * std::numbers::pi;
    std::mt19937_64 random(2);
    std::uniform_real_distribution<double> uniform(-9.0, 9.0);
    std::vector<Eigen::MatrixXd> segments;
    for (const Eigen::Index length : {1, 63, 0, 64, 65, 16384, 1, 1, 20000}) {
        Eigen::MatrixXd values(2, length);
        for (Eigen::Index i = 0; i < length; ++i)
            values.col(i) << uniform(random) * turn, uniform(random);
        for (Eigen::Index i = 5; i < length; i += 13)
            values(i % 2, i) = std::nan("");
        segments.push_back(values);
    }
    const auto series = tests::section_series({{"a", "rad", true}, {"y", "", false}}, segments);
    const SectionPoints points(series);
    REQUIRE(points.size() == series.size());
    REQUIRE(points.turns_known());
    const Eigen::VectorXd scale = series.scale();
    CHECK(points.scale() == scale);
    std::size_t i = 0, images = 0, wrong = 0;
    double largest = 0.0;
    for (const auto& segment : series.segments)
        for (Eigen::Index k = 0; k < segment.values.cols(); ++k, ++i) {
            const Eigen::VectorXd x = segment.values.col(k);
            const bool image = k + 1 < segment.values.cols() && x.allFinite() && segment.values.col(k + 1).allFinite();
            wrong += points.has_image(i) == image ? 0 : 1;
            if (!image) continue;
            ++images;
            // Scaled values are below 10: rounding of a few 1e-15.
            largest = std::max({largest, std::abs(std::remainder(points.point(i)[0] - x[0] / turn, 1.0)),
                                std::abs(points.point(i)[1] - x[1] / scale[1]),
                                std::abs(points.advance(i, 0) - (segment.values(0, k + 1) - x[0]) / turn)});
            wrong += points.point(i)[0] >= -0.5 && points.point(i)[0] < 0.5 ? 0 : 1;
        }
    CHECK(wrong == 0);
    CHECK(points.image_count() == images);
    CHECK_THAT(largest, WithinAbs(0.0, 2e-14));
}

TEST_CASE("a stretch of a section has its points, images and turns, and no image at its end",
          "[orbits][section_points]") {
    Eigen::MatrixXd values = 20.0 * Eigen::MatrixXd::Random(2, 200);
    values(1, 130) = std::nan("");
    const SectionPoints points(
        tests::section_series({{"a", "rad", true}, {"y", "", false}}, {values.leftCols(90), values.rightCols(110)}),
        std::vector<double>{-1.0, -1.0});
    constexpr std::size_t first = 61, count = 120;
    const SectionPoints part = points.stretch(first, count);
    REQUIRE(part.size() == count);
    CHECK(part.scale() == points.scale());
    CHECK(part.signs() == points.signs());
    CHECK(part.turns_known());
    std::size_t images = 0, wrong = 0;
    for (std::size_t i = 0; i < count; ++i) {
        const bool image = i + 1 < count && points.has_image(first + i);
        images += image ? 1 : 0;
        wrong += part.has_image(i) == image ? 0 : 1;
        if (!image) continue;
        wrong += part.point(i)[0] == points.point(first + i)[0] && part.point(i)[1] == points.point(first + i)[1] &&
                         part.advance(i, 0) == points.advance(first + i, 0)
                     ? 0
                     : 1;
    }
    CHECK(wrong == 0);
    CHECK(part.image_count() == images);
    CHECK(images == 120 - 1 - 1 - 2);
}

TEST_CASE("turns are unknown where they are read wrapped or are too many", "[orbits][section_points]") {
    Eigen::MatrixXd values = Eigen::MatrixXd::Random(1, 100);
    CHECK_FALSE(SectionPoints(tests::section_series({{"a", "rad", true}}, {values})).turns_known());
    values *= 100.0;
    CHECK(SectionPoints(tests::section_series({{"a", "rad", true}}, {values})).turns_known());
    values(0, 50) = 1e6;
    CHECK_FALSE(SectionPoints(tests::section_series({{"a", "rad", true}}, {values})).turns_known());
}

TEST_CASE("differences on the circle are the shortest", "[orbits][section_points]") {
    Eigen::MatrixXd values = Eigen::MatrixXd::Random(2, 100);
    const SectionPoints points(tests::section_series({{"a", "rad", true}, {"y", "", false}}, {values}), std::nullopt,
                               Eigen::Vector2d(2.0 * std::numbers::pi, 0.25));
    CHECK(points.scale() == Eigen::Vector2d(2.0 * std::numbers::pi, 0.25));
    CHECK(points.point(3)[1] == values(1, 3) / 0.25);
    CHECK(points.difference(0.25, -0.25, 0) == 0.5);
    CHECK(points.difference(0.375, -0.25, 0) == -0.375);
    CHECK(points.difference(-0.375, 0.25, 0) == 0.375);
    CHECK(points.difference(7.25, 0.5, 0) == -0.25);
    CHECK(points.difference(7.25, 0.5, 1) == 6.75);
    CHECK(std::isnan(points.difference(std::nan(""), 0.5, 0)));
    CHECK(points.wrapped(0.5, 0) == -0.5);
    CHECK(points.wrapped(-0.5, 0) == -0.5);
    CHECK(points.wrapped(2.75, 0) == -0.25);
    CHECK(points.wrapped(2.75, 1) == 2.75);
}

}  // namespace section_points_test
