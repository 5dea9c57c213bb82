#include "orbits/sections/neighbour_index.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>
#include <random>
#include <tuple>

#include "tests/catch.hpp"
#include "tests/orbits/sections/map_series.hpp"

namespace neighbour_index_test {

using namespace orbid;
using orbits::Neighbour;

namespace {

// All distances, sorted: what the grid must reproduce.
std::vector<Neighbour> by_brute_force(const orbits::SectionPoints& points, const Eigen::VectorXd& place,
                                      std::size_t k) {
    std::vector<Neighbour> all;
    for (std::size_t i = 0; i < points.size(); ++i) {
        if (!points.has_image(i)) continue;
        for (const bool mirrored : {false, true}) {
            if (mirrored && !points.symmetric()) continue;
            double distance2 = 0.0;
            for (Eigen::Index d = 0; d < points.dimension(); ++d) {
                const double r =
                    points.difference((mirrored ? points.signs()[d] : 1.0) * points.point(i)[d], place[d], d);
                distance2 += r * r;
            }
            all.push_back({distance2, static_cast<std::uint32_t>(i), mirrored});
        }
    }
    std::sort(all.begin(), all.end(), [](const Neighbour& a, const Neighbour& b) {
        return std::tuple(a.distance2, a.index, a.mirrored) < std::tuple(b.distance2, b.index, b.mirrored);
    });
    all.resize(std::min(k, all.size()));
    return all;
}

}  // namespace

TEST_CASE("box grid finds the same neighbours as brute force", "[orbits][box_grid]") {
    std::mt19937_64 random(5);
    std::uniform_real_distribution<double> uniform(-3.0, 3.0);
    for (const int dimension : {1, 2, 3, 5})
        for (const bool symmetric : {false, true}) {
            CAPTURE(dimension, symmetric);
            Eigen::MatrixXd values(dimension, 700);
            // Half of the points in a tight cluster: boxes of very different filling.
            for (Eigen::Index i = 0; i < values.cols(); ++i)
                for (Eigen::Index d = 0; d < dimension; ++d)
                    values(d, i) = uniform(random) * (i % 2 == 0 ? 1.0 : 0.05);
            std::vector<orbits::SeriesCoordinate> coordinates;
            for (int d = 0; d < dimension; ++d)
                coordinates.push_back({"x" + std::to_string(d), "", d % 2 == 0});
            const auto series = tests::section_series(coordinates, {values});
            std::optional<std::vector<double>> signs;
            if (symmetric) signs = std::vector<double>(static_cast<std::size_t>(dimension), -1.0);
            const orbits::SectionPoints points(series, signs);
            const orbits::NeighbourIndex grid(points);
            for (int trial = 0; trial < 45; ++trial) {
                Eigen::VectorXd place(dimension);
                // Inside, at the seam of the angles, and beyond the range of the others.
                for (Eigen::Index d = 0; d < dimension; ++d)
                    place[d] = (trial % 3 == 0 ? 0.3 : 0.17) * uniform(random);
                if (trial % 5 == 0) place[0] = 0.4999;
                const auto expected = by_brute_force(points, points.wrapped(place), 5000);
                for (const std::size_t k : {1U, 7U, 40U, 5000U}) {
                    const auto found = grid.nearest(place, k);
                    REQUIRE(found.size() == std::min(k, expected.size()));
                    double largest = 0.0;
                    for (std::size_t i = 0; i < found.size(); ++i)
                        largest = std::max(largest, std::abs(found[i].distance2 - expected[i].distance2));
                    REQUIRE(largest <= 1e-14);  // the two sum in different order of mirroring: rounding only
                }
            }
        }
}

TEST_CASE("points without an image are nobody's neighbours", "[orbits][box_grid]") {
    Eigen::MatrixXd values(1, 4);
    values << 0.0, 1.0, std::nan(""), 3.0;
    const auto series = tests::section_series({{"x", "", false}}, {values, values});
    const orbits::SectionPoints points(series);
    CHECK(points.image_count() == 2);
    const auto found = orbits::NeighbourIndex(points).nearest(Eigen::VectorXd::Constant(1, 3.0), 10);
    REQUIRE(found.size() == 2);
    CHECK(found[0].index == 0);
    CHECK(found[1].index == 4);
}

TEST_CASE("equal distances are ordered by index, then unmirrored first", "[orbits][box_grid]") {
    // A lattice with every point four times: coordinates and squared distances are exact in binary, in whatever order
    // they are summed, and nearly all distances occur often.
    std::mt19937_64 random(7);
    Eigen::MatrixXd values(2, 3000);
    for (Eigen::Index i = 0; i < values.cols(); ++i)
        values.col(i) << 0.125 * static_cast<double>(static_cast<int>(random() % 25) - 12),
            0.125 * static_cast<double>(static_cast<int>(random() % 25) - 12);
    const auto series = tests::section_series({{"x", "", false}, {"y", "", false}}, {values});
    for (const bool symmetric : {false, true}) {
        const orbits::SectionPoints points(series,
                                           symmetric ? std::optional(std::vector<double>{-1.0, 1.0}) : std::nullopt,
                                           Eigen::VectorXd::Constant(2, 1.0));
        const orbits::NeighbourIndex grid(points);
        std::vector<Neighbour> found;
        for (int trial = 0; trial < 30; ++trial) {
            const Eigen::VectorXd place =
                values.col(trial) + Eigen::VectorXd::Constant(2, trial % 2 == 0 ? 0.0 : 0.0625);
            const auto expected = by_brute_force(points, place, 700);
            for (const std::size_t k : {1U, 24U, 100U, 700U}) {
                CAPTURE(symmetric, trial, k);
                grid.nearest(place, k, found);
                REQUIRE(found.size() == k);
                CHECK(std::equal(
                    found.begin(), found.end(), expected.begin(), [](const Neighbour& a, const Neighbour& b) {
                        return a.distance2 == b.distance2 && a.index == b.index && a.mirrored == b.mirrored;
                    }));
            }
        }
    }
}

TEST_CASE("points closer than the grid rounds are told apart, wherever the place is", "[orbits][box_grid]") {
    // Clusters of 300 points within 1e-12 of the range, one of them at the seam of an angle, and one wild reading that
    // makes the range a thousand times larger.
    std::mt19937_64 random(11);
    std::uniform_real_distribution<double> uniform(-1.0, 1.0);
    Eigen::MatrixXd values(2, 1200);
    for (Eigen::Index i = 0; i < values.cols(); ++i)
        values.col(i) << std::numbers::pi * static_cast<double>(i % 4) / 3.0 + 1e-12 * uniform(random),
            static_cast<double>(i % 4) + 1e-12 * uniform(random);
    values(1, 600) = 3000.0;
    const auto series = tests::section_series({{"a", "rad", true}, {"y", "", false}}, {values});
    const orbits::SectionPoints points(series, std::nullopt, Eigen::Vector2d(2.0 * std::numbers::pi, 1.0));
    const orbits::NeighbourIndex grid(points);
    const double infinity = std::numeric_limits<double>::infinity();
    for (int trial = 0; trial < 40; ++trial) {
        Eigen::VectorXd place(2);
        place << static_cast<double>(trial % 4) / 6.0 + 1e-12 * uniform(random), static_cast<double>(trial % 4);
        // far outside on either side, too
        if (trial >= 20) place[1] = trial % 2 == 0 ? -1e5 : 1e300;
        if (trial >= 30) place[1] = trial % 2 == 0 ? -2500.0 : 5000.0;
        for (const std::size_t k : {1U, 24U, 500U}) {
            const auto found = grid.nearest(place, k);
            const auto expected = by_brute_force(points, points.wrapped(place), k);
            REQUIRE(found.size() == expected.size());
            for (std::size_t i = 0; i < found.size(); ++i) {
                REQUIRE(found[i].index == expected[i].index);
                REQUIRE(found[i].distance2 == expected[i].distance2);
            }
        }
    }
    CHECK(grid.nearest(points.wrapped(Eigen::Vector2d(0.0, 0.0)), 0).empty());
    CHECK(grid.nearest(Eigen::Vector2d(0.0, std::nan("")), 5).empty());
    CHECK(grid.nearest(Eigen::Vector2d(infinity, 0.0), 5).empty());
    CHECK(grid.nearest(Eigen::Vector2d(0.0, 0.0), 5000).size() == points.image_count());
}

}  // namespace neighbour_index_test
