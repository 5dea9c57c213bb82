#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <numbers>
#include <tuple>

#include "models/catalogue/registry.hpp"
#include "tests/catch.hpp"

namespace orbid::models::lorenz96_test {

using tests::WithinAbs;
using tests::WithinRel;

namespace {

constexpr double pi = std::numbers::pi;

/// A state without any regularity.
Eigen::VectorXd some_state(Eigen::Index n) {
    Eigen::VectorXd x(n);
    for (Eigen::Index i = 0; i < n; ++i)
        x[i] = 1.0 + 4.0 * std::sin(static_cast<double>(i * i + 1));
    return x;
}

/// Eigenvalue of the equilibrium x = F for the disturbance w^i, w = exp(2 pi i j / n): only the first factor of the
/// product is disturbed to first order, as it is 0 undisturbed, so lambda_j = -1 + F (w - w^-2).
std::complex<double> eigenvalue_at_rest(Eigen::Index n, Eigen::Index j, double forcing) {
    const double angle = 2.0 * pi * static_cast<double>(j) / static_cast<double>(n);
    return -1.0 + forcing * (std::polar(1.0, angle) - std::polar(1.0, -2.0 * angle));
}

}  // namespace

TEST_CASE("the advection of Lorenz 96 keeps the energy", "[models][fast]") {
    for (const Eigen::Index n : {4, 5, 40}) {
        CAPTURE(n);
        const auto system = make_system("lorenz96", "", static_cast<std::size_t>(n));
        REQUIRE(system->dimension() == n);
        const Eigen::VectorXd x = some_state(n);
        const Eigen::VectorXd f = system->rhs(x, std::array{0.0}, Eigen::VectorXd::Constant(1, 8.0));
        // d/dt sum x^2 / 2 = -sum x^2 + F sum x; rounding of terms of size 25, n of them.
        CHECK_THAT(x.dot(f), WithinAbs(-x.squaredNorm() + 8.0 * x.sum(), 1e-13 * 25.0 * static_cast<double>(n)));
        // The same ring counted from another place.
        Eigen::VectorXd turned(n), turned_f(n);
        for (Eigen::Index i = 0; i < n; ++i) {
            turned[i] = x[(i + 1) % n];
            turned_f[i] = f[(i + 1) % n];
        }
        CHECK(system->rhs(turned, std::array{0.0}, Eigen::VectorXd::Constant(1, 8.0)) == turned_f);
    }
}

TEST_CASE("equal places of Lorenz 96 stay equal and relax", "[models][fast]") {
    const auto system = make_system("lorenz96", "", 7);
    const Eigen::VectorXd theta = Eigen::VectorXd::Constant(1, 0.5);
    const auto flow =
        system->flow(Eigen::VectorXd::Constant(7, 3.0), 0.0, std::array{0.0, 1.0, 4.0}, theta, Clock::time);
    REQUIRE(flow.status == FlowStatus::ok);
    for (Eigen::Index i = 0; i < 7; ++i) {
        CHECK(flow.states(i, 0) == 3.0);
        CHECK_THAT(flow.states(i, 1), WithinAbs(0.5 + 2.5 * std::exp(-1.0), 1e-11));
        CHECK_THAT(flow.states(i, 2), WithinAbs(0.5 + 2.5 * std::exp(-4.0), 1e-11));
    }
    CHECK(system->at_rest(Eigen::VectorXd::Constant(7, 0.5), theta));
    CHECK_FALSE(system->at_rest(Eigen::VectorXd::Constant(7, 0.6), theta));
}

TEST_CASE("sensitivities of Lorenz 96 at rest are those of the linear equations", "[models][fast]") {
    // The values do not move there: the steps are found by the probe alone.
    for (const auto& [n, forcing, duration] : {std::tuple<Eigen::Index, double, double>{40, 8.0, 0.5}, {5, 0.8, 6.0}}) {
        CAPTURE(n, forcing);
        const auto system = make_system("lorenz96", "", static_cast<std::size_t>(n));
        const std::array<Eigen::Index, 1> free{0};
        const auto flow =
            system->flow_with_sensitivities(Eigen::VectorXd::Constant(n, forcing), 0.0, std::array{duration},
                                            Eigen::VectorXd::Constant(1, forcing), free, Clock::time);
        REQUIRE(flow.status == FlowStatus::ok);
        CHECK(flow.steps > 3);
        Eigen::MatrixXd exact(n, n + 1);
        for (Eigen::Index column = 0; column < n; ++column) {
            for (Eigen::Index row = 0; row < n; ++row) {
                std::complex<double> sum = 0.0;
                for (Eigen::Index j = 0; j < n; ++j)
                    sum += std::exp(eigenvalue_at_rest(n, j, forcing) * duration) *
                           std::polar(1.0, 2.0 * pi * static_cast<double>(j * (row - column)) / static_cast<double>(n));
                exact(row, column) = sum.real() / static_cast<double>(n);
            }
        }
        exact.col(n).setConstant(1.0 - std::exp(-duration));
        // Some ten steps with a relative error of at most 1e-11 each.
        CHECK((flow.sensitivities - exact).cwiseAbs().maxCoeff() < 1e-10 * exact.cwiseAbs().maxCoeff());
    }
}

TEST_CASE("the equilibrium of Lorenz 96 gives way to a wave at the critical forcing", "[models][fast]") {
    // Growth is -1 + F (cos a - cos 2a), fastest where cos a = 1/4: never below F = 8/9, and on 40 places first for
    // eight waves, a = 72 degrees, at F = 2 / sqrt 5.
    double critical = 1e300;
    for (Eigen::Index j = 0; j < 40; ++j)
        if (const double rate = eigenvalue_at_rest(40, j, 1.0).real() + 1.0; rate > 0.0)
            critical = std::min(critical, 1.0 / rate);
    CHECK_THAT(critical, WithinRel(2.0 / std::sqrt(5.0), 1e-14));
    CHECK(critical > 8.0 / 9.0);
    const auto system = make_system("lorenz96");
    for (const double forcing : {critical - 0.05, critical + 0.05}) {
        CAPTURE(forcing);
        // Small enough that its square, 1e-12, does not show in the sixth digit of what is left of it.
        const double size = 1e-6, duration = 10.0;
        Eigen::VectorXd wave(40);
        for (Eigen::Index i = 0; i < 40; ++i)
            wave[i] = std::cos(0.4 * pi * static_cast<double>(i));
        const Eigen::VectorXd rest = Eigen::VectorXd::Constant(40, forcing);
        const auto flow = system->flow(rest + size * wave, 0.0, std::array{duration},
                                       Eigen::VectorXd::Constant(1, forcing), Clock::time);
        REQUIRE(flow.status == FlowStatus::ok);
        const double growth = (flow.states.col(0) - rest).norm() / (size * wave.norm());
        CHECK_THAT(growth, WithinRel(std::exp(eigenvalue_at_rest(40, 8, forcing).real() * duration), 1e-5));
        CHECK((growth > 1.0) == (forcing > critical));
    }
}

TEST_CASE("sensitivities of Lorenz 96 agree with differences", "[models][fast]") {
    for (const Eigen::Index n : {4, 9}) {
        CAPTURE(n);
        const auto system = make_system("lorenz96", "", static_cast<std::size_t>(n));
        const Eigen::VectorXd x0 = some_state(n);
        const std::array durations{0.3, 1.0};
        const std::array<Eigen::Index, 1> free{0};
        const auto theta = [](double forcing) { return Eigen::VectorXd::Constant(1, forcing); };
        const auto plain = system->flow(x0, 0.0, durations, theta(8.0), Clock::time);
        const auto exact = system->flow_with_sensitivities(x0, 0.0, durations, theta(8.0), free, Clock::time);
        REQUIRE(exact.status == FlowStatus::ok);
        CHECK(plain.states == exact.states);
        CHECK(plain.steps == exact.steps);
        CHECK(plain.stopped_state == exact.states.col(1));
        CHECK(plain.stopped_after == 1.0);
        const double h = 1e-5;
        for (Eigen::Index j = 0; j <= n; ++j) {
            Eigen::VectorXd up = x0, down = x0;
            if (j < n) {
                up[j] += h;
                down[j] -= h;
            }
            const double shift = j == n ? h : 0.0;
            const auto above = system->flow(up, 0.0, durations, theta(8.0 + shift), Clock::time);
            const auto below = system->flow(down, 0.0, durations, theta(8.0 - shift), Clock::time);
            for (Eigen::Index k = 0; k < 2; ++k) {
                const Eigen::VectorXd difference = (above.states.col(k) - below.states.col(k)) / (2.0 * h);
                // Error of the flow over h, 1e-11 / 1e-5, and h^2 times a third derivative of some ten.
                CHECK((exact.sensitivity(k, n + 1).col(j) - difference).cwiseAbs().maxCoeff() < 1e-5);
            }
        }
    }
}

TEST_CASE("Lorenz 96 with 40 places is chaotic as published", "[models][fast]") {
    // Largest Lyapunov exponent for F = 8: 1.67 to 1.69, doubling of small errors in 0.42 units (2.1 days of Lorenz and
    // Emanuel 1998). Two neighbours, set back to their distance after each unit of time.
    const auto system = make_system("lorenz96");
    const Eigen::VectorXd theta = system->default_parameters();
    const auto after = [&](const Eigen::VectorXd& x, double duration) -> Eigen::VectorXd {
        const auto flow = system->flow(x, 0.0, std::array{duration}, theta, Clock::time,
                                       {.relative_tolerance = 1e-10, .absolute_tolerance = 1e-10});
        REQUIRE(flow.status == FlowStatus::ok);
        return flow.states.col(0);
    };
    Eigen::VectorXd x = after(some_state(40), 20.0);
    const double distance = 1e-6;
    Eigen::VectorXd apart = distance * some_state(40).normalized();
    double sum = 0.0;
    const int units = 300;
    for (int i = 0; i < units + 10; ++i) {
        const Eigen::VectorXd other = after(x + apart, 1.0);
        x = after(x, 1.0);
        const double now = (other - x).norm();
        // The first ten units turn the difference into the fastest direction.
        if (i >= 10) sum += std::log(now / distance);
        apart = (other - x) * (distance / now);
    }
    // Standard deviation of such means over 300 units, measured on ten of them: 0.02.
    CHECK_THAT(sum / units, WithinAbs(1.68, 0.1));

    // Tangent vectors leave the range of doubles after some 425 units: nothing for the values, the end for derivatives.
    CHECK(system->flow(x, 0.0, std::array{500.0}, theta, Clock::time).status == FlowStatus::ok);
    CHECK(system->flow_with_sensitivities(x, 0.0, std::array{500.0}, theta, {}, Clock::time).status ==
          FlowStatus::not_finite);
}

}  // namespace orbid::models::lorenz96_test
