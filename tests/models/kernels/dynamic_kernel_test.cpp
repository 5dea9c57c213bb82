#include "models/kernels/dynamic_kernel.hpp"

#include <array>
#include <cmath>

#include "models/catalogue/registry.hpp"
#include "models/system/kernel_system.hpp"
#include "tests/catch.hpp"

namespace orbid::models::dynamic_kernel_test {

using tests::ContainsSubstring;
using tests::WithinAbs;

namespace {

/// x_i' = x_{i+1}, x_n' = a: polynomials of time, on which the method makes no error, so that its steps grow without
/// bound and a curve turns inside one.
struct Chain {
    static constexpr std::string_view name = "chain";
    static constexpr std::string_view summary = "a chain of integrators";
    static constexpr std::string_view equations = "xi' = x(i+1), xn' = a";
    static constexpr Coordinate coordinate = real("x", "m");
    static constexpr std::size_t smallest_size = 1;
    static constexpr std::size_t default_size = 2;
    static constexpr std::array parameters{Parameter{"a", "m/s", any_real, 1.0, "slope of the last one"}};

    template <class T>
    static void rhs(const T& /*t*/, std::span<const T> x, const Values<T, 1>& p, std::span<T> f) {
        for (std::size_t i = 0; i + 1 < x.size(); ++i)
            f[i] = x[i + 1];
        f[x.size() - 1] = p[0];
    }
};

std::shared_ptr<const System> chain(std::size_t size) {
    return std::make_shared<KernelSystem>(std::make_shared<DynamicKernel<Chain>>(size));
}

Eigen::VectorXd only(double value) {
    return Eigen::VectorXd::Constant(1, value);
}

const std::array<Eigen::Index, 1> the_parameter{0};

}  // namespace

TEST_CASE("a model of any size has numbered coordinates", "[models][fast]") {
    const auto system = chain(3);
    REQUIRE(system->coordinates().size() == 3);
    CHECK(system->coordinates()[0].name == "x1");
    CHECK(system->coordinates()[2].name == "x3");
    CHECK(system->coordinates()[2].unit == "m");
    CHECK(system->kind() == Kind::autonomous);
    CHECK_FALSE(system->stiff());
    CHECK_FALSE(system->symmetry());
    CHECK(system->smooth(only(1.0)));
    CHECK(system->at_rest(Eigen::Vector3d(5.0, 0.0, 0.0), only(0.0)));
    CHECK_FALSE(system->at_rest(Eigen::Vector3d(5.0, 0.0, 1e-9), only(0.0)));
    const ReadingResult reading =
        system->readings({}, Eigen::Vector3d(1, 2, 3), std::array{0.0}, only(1.0), the_parameter);
    CHECK(reading.readings == Eigen::Vector3d(1, 2, 3));
    CHECK(reading.derivatives == Eigen::Matrix<double, 3, 4>::Identity());
}

TEST_CASE("a chain of any length moves along polynomials", "[models][fast]") {
    // More directions than one pass carries: x1 = sum x_i t^(i-1) / (i-1)! + a t^n / n!.
    const Eigen::Index n = 12;
    const auto system = chain(n);
    const Eigen::VectorXd x0 = Eigen::VectorXd::LinSpaced(n, -1.0, 1.0);
    const auto flow =
        system->flow_with_sensitivities(x0, 0.0, std::array{0.5, 2.0}, only(0.7), the_parameter, Clock::time);
    REQUIRE(flow.status == FlowStatus::ok);
    for (Eigen::Index k = 0; k < 2; ++k) {
        const double t = k == 0 ? 0.5 : 2.0;
        double term = 1.0, sum = 0.0;
        for (Eigen::Index i = 0; i <= n; ++i) {
            // Truncation of order 8 and rounding of numbers of size 10.
            CHECK_THAT(flow.sensitivity(k, n + 1)(0, i), WithinAbs(term, 1e-11));
            sum += term * (i < n ? x0[i] : 0.7);
            term *= t / static_cast<double>(i + 1);
        }
        CHECK_THAT(flow.states(0, k), WithinAbs(sum, 1e-11));
        CHECK(flow.sensitivity(k, n + 1)(n - 1, 0) == 0.0);
    }
    // Fewer directions: the same columns.
    const auto start_only = system->flow_with_sensitivities(x0, 0.0, std::array{0.5, 2.0}, only(0.7), {}, Clock::time);
    CHECK(start_only.sensitivity(1, n) == flow.sensitivity(1, n + 1).leftCols(n));
    CHECK(start_only.states == flow.states);
}

TEST_CASE("crossings of a plane by a model of any size", "[models][fast]") {
    // x1 = x0 + v t + a t^2 / 2 through x1 = c.
    const auto system = chain(2);
    const Section section{Eigen::Vector2d(1.0, 0.0), 3.0, 1};
    const double x = 1.0, v = 0.5, a = 2.0;
    const auto up = system->crossings(Eigen::Vector2d(x, v), section, 1, 100.0, only(a), the_parameter);
    REQUIRE(up.status == FlowStatus::ok);
    const double speed = std::sqrt(v * v + 2.0 * a * 2.0), time = (speed - v) / a;
    CHECK_THAT(up.times[0], WithinAbs(time, 1e-14));
    CHECK_THAT(up.states(0, 0), WithinAbs(3.0, 1e-14));
    CHECK_THAT(up.states(1, 0), WithinAbs(speed, 1e-14));
    // From 0 = x + v t + a t^2 / 2 - c: dt = -(dx + t dv + t^2 / 2 da) / speed, and speed^2 = v^2 + 2 a (c - x).
    const Eigen::Vector3d dt = -Eigen::Vector3d(1.0, time, 0.5 * time * time) / speed;
    CHECK((up.time_sensitivities.col(0) - dt).norm() < 1e-14);
    CHECK(up.sensitivities.row(0).norm() < 1e-14);
    CHECK((up.sensitivities.row(1).transpose() - Eigen::Vector3d(-a, v, 2.0) / speed).norm() < 1e-14);

    // Without derivatives the same bytes.
    const auto plain = system->crossings(Eigen::Vector2d(x, v), section, 1, 100.0, only(a));
    CHECK(plain.times == up.times);
    CHECK(plain.states == up.states);

    // It never comes back down, nor up again.
    Section down = section;
    down.direction = -1;
    CHECK(system->crossings(Eigen::Vector2d(x, v), down, 1, 100.0, only(a)).status == FlowStatus::no_crossing);
    const auto second = system->crossings(Eigen::Vector2d(x, v), section, 2, 100.0, only(a));
    CHECK(second.status == FlowStatus::no_crossing);
    CHECK(second.times.size() == 1);
    // The limit is on the time between crossings.
    CHECK(system->crossings(Eigen::Vector2d(x, v), section, 1, 0.9 * time, only(a)).status == FlowStatus::no_crossing);
    CHECK(system->crossings(Eigen::Vector2d(x, v), section, 1, 1.1 * time, only(a)).status == FlowStatus::ok);
}

TEST_CASE("a curve that turns inside a step crosses twice or not at all", "[models][fast]") {
    // x1 = (t - 100)^2 / 2 - depth falls below 0 and rises again, all inside one of the steps, which grow five times.
    const auto system = chain(2);
    for (const double depth : {0.5, 50.0, 1000.0, -0.5}) {
        CAPTURE(depth);
        const Eigen::Vector2d start(5000.0 - depth, -100.0);
        for (const int direction : {1, -1}) {
            const auto run =
                system->crossings(start, {Eigen::Vector2d(1.0, 0.0), 0.0, direction}, 1, 1000.0, only(1.0));
            if (depth < 0.0) {
                CHECK(run.status == FlowStatus::no_crossing);
                continue;
            }
            REQUIRE(run.status == FlowStatus::ok);
            CHECK(run.steps < 15);
            // Rounding of the 5000 over the speed.
            CHECK_THAT(run.times[0], WithinAbs(100.0 + direction * std::sqrt(2.0 * depth), 1e-11));
        }
    }
    // Touched: the depth is lost in rounding.
    CHECK(system->crossings(Eigen::Vector2d(5000.0, -100.0), {Eigen::Vector2d(1.0, 0.0), 0.0, 1}, 1, 1000.0, only(1.0))
              .status == FlowStatus::grazing);
}

TEST_CASE("a start on the section is no crossing", "[models][fast]") {
    const auto system = make_system("lorenz96", "", 5);
    const Eigen::VectorXd theta = system->default_parameters();
    const Section section{Eigen::VectorXd::Unit(5, 0), 2.0, 1};
    Eigen::VectorXd start(5);
    start << 1.0, 5.0, -2.0, 3.0, 0.5;
    const auto run = system->crossings(start, section, 6, 50.0, theta, the_parameter);
    REQUIRE(run.status == FlowStatus::ok);
    for (Eigen::Index k = 0; k + 1 < 6; ++k) {
        CAPTURE(k);
        CHECK_THAT(run.states(0, k), WithinAbs(2.0, 1e-13));
        // The crossing is where the flow is at that time; errors of 1e-12 per step have grown a hundred times.
        const auto flow = system->flow(start, 0.0, std::array{run.times[k]}, theta, Clock::time);
        CHECK((flow.states.col(0) - run.states.col(k)).norm() < 1e-9);
        // One after another.
        const auto next = system->crossings(run.states.col(k), section, 1, 50.0, theta);
        REQUIRE(next.status == FlowStatus::ok);
        CHECK_THAT(next.times[0], WithinAbs(run.times[k + 1] - run.times[k], 1e-9));
    }
    // Derivatives of the return map against differences.
    const double h = 1e-5;
    for (Eigen::Index j = 0; j <= 5; ++j) {
        const Eigen::VectorXd step =
            j < 5 ? Eigen::VectorXd(h * Eigen::VectorXd::Unit(5, j)) : Eigen::VectorXd::Zero(5);
        const double shift = j == 5 ? h : 0.0;
        const auto above = system->crossings(start + step, section, 2, 50.0, only(8.0 + shift));
        const auto below = system->crossings(start - step, section, 2, 50.0, only(8.0 - shift));
        const Eigen::VectorXd point = (above.states.col(1) - below.states.col(1)) / (2.0 * h);
        // h^2 times a third derivative of some thousand, and the error of the crossing over h.
        CHECK((run.sensitivities.col(6 + j) - point).norm() < 1e-5);
        CHECK_THAT(run.time_sensitivities(j, 1), WithinAbs((above.times[1] - below.times[1]) / (2.0 * h), 1e-5));
    }
}

TEST_CASE("second derivatives of a model of any size", "[models][fast]") {
    // Eight directions do not fit into one pass with the probe.
    const Eigen::Index n = 7, d = n + 1;
    const auto system = make_system("lorenz96", "", n);
    const auto at = [&](const Eigen::VectorXd& x, double forcing) {
        return system->flow_with_sensitivities(x, 0.0, std::array{0.2, 0.6}, only(forcing), the_parameter, Clock::time);
    };
    Eigen::VectorXd x0(n);
    x0 << 1.0, 5.0, -2.0, 3.0, 0.5, 2.0, 4.0;
    const auto second =
        system->flow_with_second_derivatives(x0, 0.0, std::array{0.2, 0.6}, only(8.0), the_parameter, Clock::time);
    REQUIRE(second.status == FlowStatus::ok);
    const auto first = at(x0, 8.0);
    CHECK(second.states == first.states);
    CHECK(second.sensitivities == first.sensitivities);
    const double h = 1e-5;
    for (Eigen::Index i = 0; i < d; ++i) {
        const Eigen::VectorXd step =
            i < n ? Eigen::VectorXd(h * Eigen::VectorXd::Unit(n, i)) : Eigen::VectorXd::Zero(n);
        const double shift = i == n ? h : 0.0;
        const Eigen::MatrixXd difference =
            (at(x0 + step, 8.0 + shift).sensitivities - at(x0 - step, 8.0 - shift).sensitivities) / (2.0 * h);
        for (Eigen::Index k = 0; k < 2; ++k) {
            const Eigen::MatrixXd exact = second.second_derivatives.middleCols((k * d + i) * d, d);
            // Error of a sensitivity over h, 1e-11 / 1e-5, and h^2 times a fourth derivative of some thousand.
            CHECK((exact - difference.middleCols(k * d, d)).cwiseAbs().maxCoeff() < 1e-5);
            for (Eigen::Index j = 0; j < d; ++j)
                // The order of differentiation does not matter; rounding of numbers of size 10.
                CHECK((exact.col(j) - second.second_derivatives.col((k * d + j) * d + i)).norm() < 1e-12);
        }
    }
}

TEST_CASE("what a model of any size cannot do is said", "[models][fast]") {
    const auto system = make_system("lorenz96", "", 4);
    const Eigen::VectorXd theta = system->default_parameters();
    const Eigen::Vector4d x(1.0, 2.0, 3.0, 4.0);
    CHECK(system->flow(x, 0.0, std::array{100.0}, theta, Clock::time, {.maximum_steps = 5}).status ==
          FlowStatus::step_budget);
    CHECK(system->flow(1e200 * x, 0.0, std::array{1.0}, theta, Clock::time).status == FlowStatus::not_finite);
    CHECK_THROWS_AS(system->flow(x, 0.0, std::array{1.0}, theta, Clock::phase), std::invalid_argument);
    CHECK_THROWS_AS(system->ensemble(x, 0.0, 1, theta), std::logic_error);
    CHECK_THROWS_WITH(make_system("lorenz96", "", 3), ContainsSubstring("must be >= 4"));
    CHECK_THROWS_WITH(make_system("lorenz96", "", 1000000000), ContainsSubstring("<= 10000"));
    CHECK_THROWS_WITH(make_system("lorenz96", "ring", 5), ContainsSubstring("no variants"));
    CHECK_THROWS_WITH(make_system("duffing", "", 3), ContainsSubstring("fixed number"));
    CHECK(make_system("lorenz96")->dimension() == 40);
    CHECK(make_system("lorenz96", "", 40) == make_system("lorenz96"));
}

}  // namespace orbid::models::dynamic_kernel_test
