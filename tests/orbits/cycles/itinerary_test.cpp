#include "orbits/cycles/recurrence.hpp"

#include <numbers>

#include "tests/catch.hpp"
#include "tests/orbits/sections/map_series.hpp"

namespace itinerary_test {

using namespace orbid;
using orbits::itinerary_seeds;
using orbits::SectionPoints;

TEST_CASE("one start for every itinerary, the piece that closes best", "[orbits][itinerary]") {
    // 0, 1, 2 repeated, closing better and better: x_i = i mod 3 + 0.03 (1 - i / 31)
    Eigen::MatrixXd values(1, 31);
    for (Eigen::Index i = 0; i < values.cols(); ++i)
        values(0, i) = static_cast<double>(i % 3) + 0.03 * std::pow(1.0 - static_cast<double>(i) / 31.0, 2);
    const SectionPoints points(tests::section_series({{"x", "", false}}, {values}));
    CHECK(itinerary_seeds(points, 1, 0.1, 0.1).empty());
    CHECK(itinerary_seeds(points, 2, 0.1, 0.1).empty());
    const auto seeds = itinerary_seeds(points, 3, 0.1, 0.1);
    REQUIRE(seeds.size() == 1);
    CHECK(seeds[0].start == 27);
    CHECK(seeds[0].recurrences == 28);  // starts 0 ... 27, at all three shifts
    CHECK(itinerary_seeds(points, 6, 0.1, 0.1).at(0).recurrences == 25);
    // The largest gap is 0.03 / 2 (1 - (28 / 31)^2), the smallest 100 times less: narrower boxes hold fewer.
    const auto few = itinerary_seeds(points, 3, 0.001, 0.1);
    REQUIRE(few.size() == 1);
    CHECK(few[0].recurrences < 20);
}

TEST_CASE("itineraries do not cross segments or missing samples", "[orbits][itinerary]") {
    Eigen::MatrixXd values(1, 31);
    for (Eigen::Index i = 0; i < values.cols(); ++i)
        values(0, i) = static_cast<double>(i % 3);
    values(0, 10) = std::nan("");
    const SectionPoints holed(tests::section_series({{"x", "", false}}, {values, values.leftCols(3)}));
    // starts 0 ... 6 before the hole (last return at 9), 11 ... 27 after it, none in the short segment
    CHECK(itinerary_seeds(holed, 3, 0.01, 0.1).at(0).recurrences == 24);
}

TEST_CASE("mirrored itineraries are one, and angles have no seam", "[orbits][itinerary]") {
    constexpr double turn = 2.0 * std::numbers::pi;
    // A point at a tenth of a turn and its mirror image, visited in turn for a while each; then both sides of the seam.
    Eigen::MatrixXd angles(1, 60);
    for (Eigen::Index i = 0; i < 40; ++i)
        angles(0, i) = i / 10 % 2 == 0 ? 0.1 * turn : -0.1 * turn;
    for (Eigen::Index i = 40; i < 60; ++i)
        angles(0, i) = (i % 2 == 0 ? 0.5 : -0.5) * turn * (1.0 - 1e-4);
    const auto series = tests::section_series({{"a", "rad", true}}, {angles});
    CHECK(itinerary_seeds(SectionPoints(series), 1, 0.01, 0.03).size() == 3);
    const auto seeds = itinerary_seeds(SectionPoints(series, std::vector<double>{-1.0}), 1, 0.01, 0.03);
    REQUIRE(seeds.size() == 2);
    CHECK(seeds[0].recurrences == 36);
    CHECK(seeds[1].recurrences == 19);
}

}  // namespace itinerary_test
