#include "estimator/estimate/reported_interval.hpp"

#include <cmath>

#include "tests/catch.hpp"

namespace reported_interval_test {

using namespace orbid;
using tests::WithinRel;

namespace {

/// Of a scale of 2 whose variance is known by nu degrees of freedom.
estimator::EstimatedScale scale_of(double nu) {
    estimator::EstimatedScale scale;
    scale.value = 2.0;
    scale.uncertainty = 2.0 * std::sqrt(0.5 / nu);
    estimator::fill_interval(scale);
    return scale;
}

}  // namespace

TEST_CASE("the interval of a scale is that of chi-squared", "[estimator]") {
    // Table of chi-squared: 2.5 and 97.5 % of ten degrees of freedom.
    const estimator::EstimatedScale ten = scale_of(10.0);
    CHECK_THAT(ten.lower95, WithinRel(2.0 * std::sqrt(10.0 / 20.483177), 1e-7));
    CHECK_THAT(ten.upper95, WithinRel(2.0 * std::sqrt(10.0 / 3.246973), 1e-7));
}

TEST_CASE("the interval of a scale has no gap where the normal law takes over, and no end to it", "[estimator]") {
    const estimator::EstimatedScale below = scale_of(0.999999e9), above = scale_of(1.000001e9);
    const double width = below.upper95 - below.lower95;
    CHECK(width > above.upper95 - above.lower95);
    CHECK(std::abs(below.lower95 - above.lower95) < 1e-5 * width);
    CHECK(std::abs(below.upper95 - above.upper95) < 1e-5 * width);
    for (const double nu : {8e16, 1e20, 1e300}) {
        const estimator::EstimatedScale scale = scale_of(nu);
        CHECK_THAT(scale.lower95, WithinRel(2.0, 1e-7));
        CHECK_THAT(scale.upper95, WithinRel(2.0, 1e-7));
        CHECK(scale.lower95 <= scale.upper95);
    }
}

}  // namespace reported_interval_test
