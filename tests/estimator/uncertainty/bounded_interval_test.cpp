#include "estimator/uncertainty/bounded_interval.hpp"

#include <cmath>
#include <limits>

#include "estimator/estimate/estimate.hpp"
#include "tests/catch.hpp"
#include "tests/estimator/interface/function_residual.hpp"

namespace orbid::tests::bounded_interval_test {

namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();
constexpr double normal = 1.9599639845400545;

/// A straight line through readings at t = 0, 1, 2, 3 with sd 1, the slope not negative.
estimator::Estimate line(const Eigen::Vector4d& y, double lower) {
    Eigen::MatrixXd x(4, 2);
    x << 1, 0, 1, 1, 1, 2, 1, 3;
    FunctionResidual residual;
    residual.add_group(group("y", 1.0, false));
    residual.add_block(layout("data", 4), linear(y, x));
    auto slope = free_parameter("b", 0.5);
    slope.lower = lower;
    return estimator::estimate({free_parameter("a", 1.0), slope}, {&residual});
}

}  // namespace

TEST_CASE("a normal density cut at a bound has its own limit", "[estimator][bounds]") {
    // m + s Phi^-1(a + 0.95 (1 - a)), a = Phi((lower - m) / s), by Python's statistics.NormalDist.
    struct Row {
        double mode, sd, limit;
    };
    for (const Row& row : {Row{1.0, 1.0, 2.7271848288214375}, Row{0.0, 1.0, normal}, Row{-0.5, 1.0, 1.6589537675953059},
                           Row{-3.0, 2.0, 2.424708029016868}}) {
        CAPTURE(row.mode, row.sd);
        const auto low = estimator::bounded_interval(row.mode, row.sd, normal, 0.0, infinity);
        CHECK(low.lower == 0.0);
        CHECK_THAT(low.upper, WithinRel(row.limit, 1e-9));
        CHECK(low.limit == estimator::BoundSide::upper);
        const auto high = estimator::bounded_interval(-row.mode, row.sd, normal, -infinity, 0.0);
        CHECK(high.upper == 0.0);
        CHECK_THAT(high.lower, WithinRel(-row.limit, 1e-9));
        CHECK(high.limit == estimator::BoundSide::lower);
    }
}

TEST_CASE("far beyond a bound the limit is that of an exponential rate", "[estimator][bounds]") {
    // exp(-z x - x^2 / 2): ln 20 / z up to terms of 1 / z^2.
    for (const double z : {20.0, 50.0, 200.0}) {
        CAPTURE(z);
        const auto interval = estimator::bounded_interval(-z, 1.0, normal, 0.0, infinity);
        CHECK_THAT(interval.upper, WithinRel(std::log(20.0) / z, 3.0 / (z * z)));
    }
}

TEST_CASE("where tails underflow the limit is that of their power or rate", "[estimator][bounds]") {
    // Student's t with two degrees of freedom falls like x^-2: a twentieth lies beyond sqrt(20) x.
    const auto heavy = estimator::bounded_interval(-1e100, 1.0, 4.302652729911275, 0.0, infinity);
    CHECK_THAT(heavy.upper, WithinRel((std::sqrt(20.0) - 1.0) * 1e100, 1e-6));
    // With 50, quantile 2.00856, (1 + x^2 / 50)^-25 is 1e-190 at x = 4.5e4; nearer its tail is a number.
    const auto many = estimator::bounded_interval(-1e6, 1.0, 2.0085591121007611, 0.0, infinity);
    CHECK_THAT(many.upper, WithinRel((std::pow(20.0, 1.0 / 50.0) - 1.0) * 1e6, 1e-3));
    // Both ways meet: where the tail of t with 100 is 1e-190, x = 794.
    for (const double x : {600.0, 700.0, 800.0, 900.0, 1000.0}) {
        const auto here = estimator::bounded_interval(-x, 1.0, 1.9839715184496334, 0.0, infinity);
        CHECK_THAT(here.upper + x, WithinRel(std::sqrt((x * x + 100.0) * std::pow(20.0, 0.02) - 100.0), 1e-4));
    }
}

TEST_CASE("Student's t with two degrees of freedom is cut by its closed form", "[estimator][bounds]") {
    // F(x) = 1/2 + x / (2 sqrt(2 + x^2)),  F^-1(p) = (2 p - 1) / sqrt(2 p (1 - p)).
    const auto below = [](double x) { return 0.5 + 0.5 * x / std::sqrt(2.0 + x * x); };
    const auto at = [](double p) { return (2.0 * p - 1.0) / std::sqrt(2.0 * p * (1.0 - p)); };
    const double a = below(-1.5);
    const auto interval = estimator::bounded_interval(1.5, 1.0, at(0.975), 0.0, infinity);
    CHECK_THAT(interval.upper, WithinRel(1.5 + at(a + 0.95 * (1.0 - a)), 1e-8));
}

TEST_CASE("intervals within bounds stay, those beyond both are the bounds", "[estimator][bounds]") {
    const auto inside = estimator::bounded_interval(1.0, 0.1, normal, 0.0, 2.0);
    CHECK(inside.lower == 1.0 - normal * 0.1);
    CHECK(inside.upper == 1.0 + normal * 0.1);
    CHECK(inside.limit == estimator::BoundSide::none);
    const auto open = estimator::bounded_interval(1.0, 30.0, normal, 0.0, 2.0);
    CHECK(open.lower == 0.0);
    CHECK(open.upper == 2.0);
    CHECK(open.limit == estimator::BoundSide::none);
    CHECK(std::isnan(estimator::bounded_interval(1.0, std::nan(""), normal, 0.0, 2.0).lower));
}

TEST_CASE("a parameter at or near its bound has a limit of its marginal density", "[estimator][bounds]") {
    // Least squares without the bound: slope sum (t - 3/2) y / 5, sd 1 / sqrt(5).
    const double sd = 1.0 / std::sqrt(5.0);
    const auto limit = [&](double mode) {
        const auto tail = [](double x) { return 0.5 * std::erfc(x / std::sqrt(2.0)); };
        double low = 0.0;
        double high = 10.0;
        for (int i = 0; i < 100; ++i) {
            const double middle = 0.5 * (low + high);
            (tail((middle - mode) / sd) > 0.05 * tail(-mode / sd) ? low : high) = middle;
        }
        return low;
    };
    // Slopes of least squares: -0.45 and 0.11.
    for (const Eigen::Vector4d& y : {Eigen::Vector4d(1.0, 0.3, 0.6, -0.6), Eigen::Vector4d(0.5, 0.3, 0.8, 0.7)}) {
        const double slope = (Eigen::Vector4d(-1.5, -0.5, 0.5, 1.5).dot(y)) / 5.0;
        const auto result = line(y, 0.0);
        const estimator::Estimated& b = result.parameters[1];
        CAPTURE(slope, b.value, b.upper95, result.message);
        CHECK(b.lower95 == 0.0);
        CHECK(b.limit == estimator::BoundSide::upper);
        CHECK_THAT(b.upper95, WithinRel(limit(slope), 1e-6));
        CHECK((b.at_bound == estimator::BoundSide::lower) == (slope < 0.0));
        CHECK(b.interval_method == estimator::IntervalMethod::normal);
    }
    const auto wide = line(Eigen::Vector4d(0.5, 0.3, 0.8, 0.7), -5.0);
    CHECK_THAT(wide.parameters[1].lower95, WithinAbs(0.11 - normal * sd, 1e-6));
    CHECK(wide.parameters[1].limit == estimator::BoundSide::none);
}

TEST_CASE("the interval of a function of one parameter is that function of its interval", "[estimator][bounds]") {
    // A mean life is 1 / rate: both intervals say the same, and neither reaches zero.
    FunctionResidual residual;
    residual.add_group(group("y", 0.7, false));
    residual.add_block(layout("data", 1),
                       linear(Eigen::VectorXd::Constant(1, 2.0), Eigen::MatrixXd::Constant(1, 1, 1.0)));
    auto rate = free_parameter("rate", 1.0);
    rate.scale = estimator::Scale::log;
    rate.lower = 0.0;
    const estimator::DerivedQuantity life{
        "life", [](const Eigen::VectorXd& x) { return 1.0 / x[0]; },
        [](const Eigen::VectorXd& x) { return Eigen::VectorXd(Eigen::VectorXd::Constant(1, -1.0 / (x[0] * x[0]))); }};
    const auto result = estimator::estimate({rate}, {&residual}, {life});
    const auto& own = result.parameters[0];
    CHECK_THAT(own.value, WithinRel(2.0, 1e-6));
    CHECK_THAT(result.derived[0].lower95, WithinRel(1.0 / own.upper95, 1e-9));
    CHECK_THAT(result.derived[0].upper95, WithinRel(1.0 / own.lower95, 1e-9));
}

}  // namespace orbid::tests::bounded_interval_test
