#include "estimator/sampling/unbounded_coordinate.hpp"

#include <cmath>
#include <limits>
#include <numbers>

#include "tests/catch.hpp"

namespace orbid::tests::unbounded_coordinate_test {

constexpr double infinity = std::numeric_limits<double>::infinity();

TEST_CASE("unbounded coordinates: round trips and log-Jacobians", "[estimator]") {
    const auto check = [](const estimator::UnboundedCoordinate& coordinate, double v) {
        CAPTURE(coordinate.lower, coordinate.upper, v);
        const double u = coordinate.bounded(v);
        CHECK(u > coordinate.lower);
        CHECK(u < coordinate.upper);
        // The distance from a limit of size one keeps 1e-16 / e^-5 of its digits.
        CHECK_THAT(coordinate.at(u), WithinAbs(v, 1e-12));
        // Central differences of step 1e-4 have an error below 1e-8 of the third derivative.
        const double h = 1e-4;
        CHECK_THAT(coordinate.slope(v),
                   WithinRel((coordinate.bounded(v + h) - coordinate.bounded(v - h)) / (2.0 * h), 1e-7));
        CHECK_THAT(std::log(coordinate.slope(v)), WithinAbs(coordinate.ln_slope(v), 1e-13));
        CHECK_THAT(coordinate.ln_slope_first(v),
                   WithinAbs((coordinate.ln_slope(v + h) - coordinate.ln_slope(v - h)) / (2.0 * h), 1e-8));
        CHECK_THAT(coordinate.ln_slope_second(v),
                   WithinAbs((coordinate.ln_slope_first(v + h) - coordinate.ln_slope_first(v - h)) / (2.0 * h), 1e-8));
    };
    for (const double v : {-5.0, -1.0, 0.0, 0.5, 5.0})
        for (const auto& coordinate :
             {estimator::UnboundedCoordinate{}, estimator::UnboundedCoordinate{1.0, infinity},
              estimator::UnboundedCoordinate{1.0, infinity, 0.3}, estimator::UnboundedCoordinate{-infinity, -2.0, 2.0},
              estimator::UnboundedCoordinate{-1.0, 3.0}})
            check(coordinate, v);
    // Closed forms: the middle of an interval, ln 2 inside a limit, and linear far from it.
    CHECK(estimator::UnboundedCoordinate{-1.0, 3.0}.bounded(0.0) == 1.0);
    CHECK(estimator::UnboundedCoordinate{-1.0, 3.0}.slope(0.0) == 1.0);
    CHECK_THAT(estimator::UnboundedCoordinate({1.0, infinity, 3.0}).bounded(0.0),
               WithinRel(1.0 + 3.0 * std::numbers::ln2, 1e-15));
    CHECK_THAT(estimator::UnboundedCoordinate({-infinity, -2.0, 3.0}).bounded(0.0),
               WithinRel(-2.0 - 3.0 * std::numbers::ln2, 1e-15));
    CHECK(estimator::UnboundedCoordinate{1.0, infinity, 3.0}.bounded(800.0) == 2401.0);
    CHECK(estimator::UnboundedCoordinate{1.0, infinity, 3.0}.at(2401.0) == 800.0);
    // The logistic density integrates to the width: du/dv over all v, by the trapezoidal rule (exact to rounding here).
    double width = 0.0;
    for (int i = -4000; i <= 4000; ++i)
        width += 0.01 * estimator::UnboundedCoordinate{-1.0, 3.0}.slope(0.01 * i);
    CHECK_THAT(width, WithinRel(4.0, 1e-12));
}

}  // namespace orbid::tests::unbounded_coordinate_test
