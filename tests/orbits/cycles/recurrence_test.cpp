#include "orbits/cycles/recurrence.hpp"

#include "tests/catch.hpp"
#include "tests/orbits/sections/map_series.hpp"

namespace recurrence_test {

using namespace orbid;

TEST_CASE("an exactly periodic series is one group per period", "[orbits][recurrence]") {
    // 0, 1, 2 repeated; boxes of a hundredth of the range
    Eigen::MatrixXd values(1, 31);
    for (Eigen::Index i = 0; i < values.cols(); ++i)
        values(0, i) = static_cast<double>(i % 3);
    const orbits::SectionPoints points(tests::section_series({{"x", "", false}}, {values}));
    CHECK(orbits::recurrence_seeds(points, 1, 0.01, 1).empty());
    CHECK(orbits::recurrence_seeds(points, 2, 0.01, 1).empty());
    const auto seeds = orbits::recurrence_seeds(points, 3, 0.01, 1);
    REQUIRE(seeds.size() == 1);
    CHECK(seeds[0].start == 0);
    CHECK(seeds[0].recurrences == 28);  // starts 0 ... 27, at all three shifts
    CHECK(orbits::recurrence_seeds(points, 3, 0.01, 29).empty());
    CHECK(orbits::recurrence_seeds(points, 6, 0.01, 1)[0].recurrences == 25);
}

TEST_CASE("recurrences do not cross segments, missing samples or fall through the seam", "[orbits][recurrence]") {
    Eigen::MatrixXd values(1, 31);
    for (Eigen::Index i = 0; i < values.cols(); ++i)
        values(0, i) = static_cast<double>(i % 3);
    values(0, 10) = std::nan("");
    const orbits::SectionPoints holed(tests::section_series({{"x", "", false}}, {values, values.leftCols(3)}));
    // starts 0 ... 6 before the hole (last return at 9), 11 ... 27 after it, none in the short segment
    CHECK(orbits::recurrence_seeds(holed, 3, 0.01, 1)[0].recurrences == 24);

    // An angle that alternates between the two sides of the seam returns to a neighbouring box.
    Eigen::MatrixXd angles(1, 20);
    for (Eigen::Index i = 0; i < angles.cols(); ++i)
        angles(0, i) = (i % 2 == 0 ? 1.0 : -1.0) * (3.1415 - 1e-4 * double(i));
    const orbits::SectionPoints circle(tests::section_series({{"a", "rad", true}}, {angles}));
    CHECK(orbits::recurrence_seeds(circle, 1, 0.01, 1)[0].recurrences == 19);
}

TEST_CASE("mirrored pieces join one group", "[orbits][recurrence]") {
    // Two fixed points at +1 and -1, visited in turn for a while each.
    Eigen::MatrixXd values(1, 40);
    for (Eigen::Index i = 0; i < values.cols(); ++i)
        values(0, i) = i / 10 % 2 == 0 ? 1.0 : -1.0;
    const auto series = tests::section_series({{"x", "", false}}, {values});
    CHECK(orbits::recurrence_seeds(orbits::SectionPoints(series), 1, 0.01, 1).size() == 2);
    const auto seeds = orbits::recurrence_seeds(orbits::SectionPoints(series, std::vector<double>{-1.0}), 1, 0.01, 1);
    REQUIRE(seeds.size() == 1);
    CHECK(seeds[0].recurrences == 36);
}

}  // namespace recurrence_test
