// What is said of section series that cannot be right.
#include "orbits/sections/section_check.hpp"

#include <limits>

#include "orbits/cycles/cycle_search.hpp"
#include "tests/catch.hpp"
#include "tests/orbits/sections/map_series.hpp"

namespace section_check_test {

using namespace orbid;
using orbits::check_section;
using tests::ContainsSubstring;

namespace {

const std::vector<int> periods{1, 2, 3};

orbits::Series henon() {
    return tests::henon_series(4000);
}

}  // namespace

TEST_CASE("a sound series passes without remarks", "[orbits][check]") {
    CHECK(check_section(henon(), periods).empty());
    CHECK(check_section(tests::standard_map_series(20000), periods).empty());
    auto small = henon();  // an angle of tiny range is an angle
    small.coordinates[0].angle = true;
    CHECK(check_section(small, periods).empty());
}

TEST_CASE("coordinates without readings or spread are named", "[orbits][check]") {
    auto series = henon();
    series.segments[0].values.row(1).setConstant(std::numeric_limits<double>::quiet_NaN());
    CHECK_THROWS_WITH(check_section(series, periods),
                      ContainsSubstring("coordinate 'y' has no readings: all 4000 of them are missing (nan)"));
    series.segments[0].values.row(1).setConstant(1.5);
    CHECK_THROWS_WITH(check_section(series, periods),
                      ContainsSubstring("'y' has no spread: all 4000 readings are 1.5"));
    CHECK_THROWS_WITH(find_cycles(series, {}), ContainsSubstring("'y' has no spread"));
    for (double& value : series.segments[0].values.reshaped())
        value = std::nearbyint(value * 2.0) * 0.5;
    series.segments[0].values.row(1) = henon().segments[0].values.row(1);
    CHECK_THROWS_WITH(
        check_section(series, periods),
        ContainsSubstring("coordinate 'x' has only 7 different readings") && ContainsSubstring("in steps of 0.5"));
}

TEST_CASE("points without images and periods beyond the pieces", "[orbits][check]") {
    const auto whole = henon();
    orbits::Series single = whole;
    single.segments.clear();
    for (Eigen::Index i = 0; i < 1000; ++i)
        single.segments.push_back({std::to_string(i), whole.segments[0].values.col(i), {}, {}});
    CHECK_THROWS_WITH(check_section(single, periods), ContainsSubstring("every segment is a single point"));
    orbits::Series holes = whole;
    for (Eigen::Index i = 0; i < 4000; i += 2)
        holes.segments[0].values(0, i) = std::numeric_limits<double>::quiet_NaN();
    CHECK_THROWS_WITH(check_section(holes, periods), ContainsSubstring("no two points that follow each other"));
    orbits::Series triples = whole;
    triples.segments.clear();
    for (Eigen::Index i = 0; i < 900; i += 3)
        triples.segments.push_back({std::to_string(i), whole.segments[0].values.middleCols(i, 3), {}, {}});
    CHECK_THROWS_WITH(check_section(triples, {3, 4}),
                      ContainsSubstring("period 3 needs pieces of at least 4 successive points; the longest without a "
                                        "break has 3"));
    const auto remarks = check_section(triples, {1, 2, 3});
    REQUIRE(remarks.size() == 1);
    CHECK_THAT(remarks[0], ContainsSubstring("Periods from 3 on cannot recur"));
}

TEST_CASE("steps of readings and repeated points are remarked on", "[orbits][check]") {
    auto series = henon();
    for (double& value : series.segments[0].values.row(0))
        value = 0.01 * std::nearbyint(100.0 * value);
    const auto steps = check_section(series, periods);
    REQUIRE(steps.size() == 1);
    CHECK_THAT(steps[0],
               ContainsSubstring("'x' is read in steps of 0.01: each reading is uncertain by at least 0.0029"));

    series = henon();
    series.segments.push_back(series.segments[0]);
    series.segments[1].label = "copy";
    const auto copies = check_section(series, periods);
    REQUIRE(copies.size() == 1);
    CHECK_THAT(copies[0], ContainsSubstring("3999 of 7998 points occur more than once with the same image") &&
                              ContainsSubstring("segment 'copy'"));
}

TEST_CASE("an angle that is not declared as one is proposed", "[orbits][check]") {
    auto series = tests::standard_map_series(20000);
    series.coordinates[0].angle = false;
    CHECK_THROWS_WITH(check_section(series, periods),
                      ContainsSubstring("coordinate 'x' spans 6.28") && ContainsSubstring("an angle in radians"));
    series.segments[0].values.row(0) *= 180.0 / std::numbers::pi;
    CHECK_THROWS_WITH(check_section(series, periods),
                      ContainsSubstring("declare it an angle and convert it to radians"));
    series.coordinates[0].angle = true;
    const auto remarks = check_section(series, periods);
    REQUIRE(remarks.size() == 1);
    CHECK_THAT(remarks[0], ContainsSubstring("as degrees do"));
}

}  // namespace section_check_test
