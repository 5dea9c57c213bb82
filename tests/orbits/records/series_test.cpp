#include "orbits/records/series.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <memory>
#include <numbers>
#include <random>
#include <utility>
#include <vector>

#include "orbits/records/nearest_name.hpp"
#include "orbits/records/unit.hpp"
#include "tests/catch.hpp"

namespace series_test {

using namespace orbid;
using orbits::Series;
using tests::WithinAbs;
using tests::WithinRel;

TEST_CASE("size counts the points of all segments", "[orbits]") {
    Series series;
    series.coordinates = {{"x", "", false}};
    CHECK(series.size() == 0);
    series.segments = {{"0", Eigen::MatrixXd::Zero(1, 3), {}}, {"1", Eigen::MatrixXd::Zero(1, 4), {}}};
    CHECK(series.size() == 7);
    CHECK(series.dimension() == 1);
}

TEST_CASE("scale is a turn for angles and the central 99.8 % range otherwise", "[orbits]") {
    // 0, 1, ..., 1000 in two segments: the 0.1 % and 99.9 % quantiles are exactly 1 and 999. A missing sample and one
    // wild reading among so many change nothing but the position of the quantiles.
    Series series;
    series.coordinates = {{"phi", "rad", true}, {"x", "m", false}, {"constant", "m", false}};
    Eigen::MatrixXd values(3, 1001);
    for (Eigen::Index k = 0; k <= 1000; ++k)
        values.col(k) << 0.01, static_cast<double>((k * 387) % 1001), 5.0;
    series.segments = {{"0", values.leftCols(300), {}}, {"1", values.rightCols(701), {}}};
    const Eigen::VectorXd scale = series.scale();
    REQUIRE(scale.size() == 3);
    CHECK(scale[0] == 2.0 * std::numbers::pi);
    CHECK_THAT(scale[1], WithinRel(998.0, 1e-14));
    CHECK(scale[2] == 1.0);

    series.segments[0].values(1, 0) = std::numeric_limits<double>::quiet_NaN();
    // 1000 values remain, 1 ... 1000 with 0 gone: quantiles at positions 0.999 and 998.001.
    CHECK_THAT(series.scale()[1], WithinRel(998.001 - 0.999, 1e-12));
}

TEST_CASE("scale of many values is that of sorting them, whatever their distribution", "[orbits]") {
    // More values than are sorted at once; the reference sorts all: quantiles at 0.1 % and 99.9 % of count - 1.
    std::mt19937_64 random(1);
    std::normal_distribution<double> normal;
    constexpr Eigen::Index count = 70001;
    const std::vector<std::function<double()>> distributions{
        [&] { return normal(random); }, [&] { return std::exp(20.0 * normal(random)); },  // over fifty powers of ten
        [&] { return std::round(3.0 * normal(random)); },                                 // ties, zeros of both signs
        [&] { return 1e6 + 1e-9 * normal(random); },                                      // a few hundred doubles apart
        [&] { return random() % 1000 == 0 ? 1e300 : normal(random); }};  // one quantile in the wild readings
    for (std::size_t i = 0; i < distributions.size(); ++i) {
        CAPTURE(i);
        Series series;
        series.coordinates = {{"x", "m", false}};
        Eigen::MatrixXd values(1, count);
        for (double& value : values.reshaped())
            value = distributions[i]();
        series.segments = {{"0", values.leftCols(123), {}}, {"1", values.rightCols(count - 123), {}}};
        std::vector<double> sorted(values.data(), values.data() + count);
        std::sort(sorted.begin(), sorted.end());
        const auto quantile = [&](double share) {
            const double position = share * (count - 1);
            const auto at = static_cast<std::size_t>(position);
            return sorted[at] + (position - std::floor(position)) * (sorted[at + 1] - sorted[at]);
        };
        CHECK(series.scale()[0] == quantile(1.0 - 0.001) - quantile(0.001));
    }
}

TEST_CASE("scale of a coordinate without readings is one", "[orbits]") {
    Series series;
    series.coordinates = {{"x", "m", false}};
    CHECK(series.scale()[0] == 1.0);
    series.segments = {{"0", Eigen::MatrixXd::Constant(1, 2, std::numeric_limits<double>::quiet_NaN()), {}}};
    CHECK(series.scale()[0] == 1.0);
}

TEST_CASE("units turn into each other when they measure the same", "[orbits]") {
    CHECK(*orbits::unit_factor("rad", "rad") == 1.0);
    CHECK(*orbits::unit_factor("", "m") == 1.0);
    CHECK(*orbits::unit_factor("furlong", "furlong") == 1.0);
    CHECK_THAT(*orbits::unit_factor("deg", "rad"), WithinRel(std::numbers::pi / 180.0, 1e-15));
    CHECK_THAT(*orbits::unit_factor("turns", "deg"), WithinRel(360.0, 1e-15));
    CHECK_THAT(*orbits::unit_factor("rpm", "rad/s"), WithinRel(2.0 * std::numbers::pi / 60.0, 1e-15));
    CHECK_THAT(*orbits::unit_factor("ms", "s"), WithinRel(1e-3, 1e-15));
    CHECK_THAT(*orbits::unit_factor("g", "m/s^2"), WithinRel(9.80665, 1e-15));
    CHECK_FALSE(orbits::unit_factor("deg", "s").has_value());
    CHECK_FALSE(orbits::unit_factor("degrees", "rad").has_value());
    CHECK_THAT(orbits::units_like("rad"), tests::ContainsSubstring("deg"));
    CHECK(orbits::units_like("parsec") == "parsec");
}

TEST_CASE("the nearest name is found, far ones are not suggested", "[orbits]") {
    const std::vector<std::string> known{"segment", "t", "theta", "theta_dot"};
    CHECK(orbits::nearest_name("theta_dt", known) == "theta_dot");
    CHECK(orbits::nearest_name("Theta", known) == "theta");
    CHECK(orbits::nearest_name("segmnet", known) == "segment");
    CHECK_FALSE(orbits::nearest_name("velocity", known).has_value());
    CHECK_FALSE(orbits::nearest_name("x", known).has_value());
}

TEST_CASE("readings look at numbers of others, or own theirs", "[orbits]") {
    const auto numbers = std::make_shared<std::vector<double>>(std::vector<double>{1, 2, 3, 4, 5, 6});
    auto looking = orbits::Readings::borrowed(numbers->data(), 2, 3, numbers);
    CHECK(looking.data() == numbers->data());
    CHECK(looking(1, 2) == 6.0);
    CHECK(numbers.use_count() == 2);

    // Copies look at the same numbers and keep them; so does what a copy was moved to.
    orbits::Readings copy = looking;
    CHECK(copy.data() == numbers->data());
    const orbits::Readings moved = std::move(copy);
    CHECK(moved.data() == numbers->data());
    CHECK(numbers.use_count() == 3);

    // What is assigned is owned: the numbers stay as they are.
    looking = looking.leftCols(2) * 2.0;
    CHECK(looking.cols() == 2);
    CHECK(looking(0, 1) == 6.0);
    CHECK_FALSE(looking.owner());
    CHECK(numbers.use_count() == 2);
    looking(0, 1) = 0.0;
    CHECK((*numbers)[2] == 3.0);

    // Copies of owned readings are their own.
    orbits::Readings other = looking;
    other(0, 0) = -1.0;
    CHECK(looking(0, 0) == 2.0);
    orbits::Readings taken = std::move(other);
    CHECK(taken(0, 0) == -1.0);
    taken = taken.topRows(1).eval();
    taken.conservativeResize(2, Eigen::NoChange);
    CHECK(taken(0, 0) == -1.0);
    CHECK(taken.rows() == 2);
    taken.resize(3, 1);
    CHECK(taken.size() == 3);
}

}  // namespace series_test
