#include <array>
#include <cmath>
#include <functional>
#include <numbers>
#include <vector>

#include "models/catalogue/registry.hpp"
#include "models/kernels/model_system.hpp"
#include "tests/catch.hpp"
#include "tests/models/trajectories/dry_oscillator.hpp"

namespace orbid::models::second_order_test {

namespace {

constexpr double pi = std::numbers::pi;
using Free = std::vector<Eigen::Index>;

const System& oscillator() {
    static const ModelSystem<tests::DryOscillator> system;
    return system;
}

/// Second derivatives of a function in two of its arguments, of fourth order: with long doubles good to some 1e-12.
using Function = std::function<long double(const std::vector<long double>&)>;
double second_difference(const Function& f, const std::vector<double>& at, std::size_t i, std::size_t j) {
    const long double h = 2e-4L;
    const std::array<long double, 4> offset{-2.0L, -1.0L, 1.0L, 2.0L},
        weight{1.0L / 12, -8.0L / 12, 8.0L / 12, -1.0L / 12};
    long double sum = 0.0L;
    for (std::size_t a = 0; a < 4; ++a)
        for (std::size_t b = 0; b < 4; ++b) {
            std::vector<long double> x(at.begin(), at.end());
            x[i] += offset[a] * h;
            x[j] += offset[b] * h;
            sum += weight[a] * weight[b] * f(x);
        }
    return static_cast<double>(sum / (h * h));
}

/// Worst difference between second derivatives and central differences of the first ones, relative to their size.
double difference_error(const System& system, const Eigen::VectorXd& x0, double phase, double duration,
                        const Eigen::VectorXd& theta, const Free& free, Clock clock) {
    const std::array<double, 1> durations{duration};
    const auto exact = system.flow_with_second_derivatives(x0, phase, durations, theta, free, clock);
    REQUIRE(exact.status == FlowStatus::ok);
    const Eigen::Index n = x0.size(), d = n + static_cast<Eigen::Index>(free.size());
    REQUIRE(exact.second_derivatives.cols() == d * d);
    const auto unit = [&](Eigen::Index j) {
        return j < n ? 1.0 : std::abs(theta[free[static_cast<std::size_t>(j - n)]]);
    };
    double worst = 0.0;
    for (Eigen::Index i = 0; i < d; ++i) {
        const double h = 1e-4 * unit(i);
        const auto at = [&](double step) -> Eigen::MatrixXd {
            Eigen::VectorXd x = x0, p = theta;
            (i < n ? x[i] : p[free[static_cast<std::size_t>(i - n)]]) += step;
            return system.flow_with_sensitivities(x, phase, durations, p, free, clock).sensitivities;
        };
        const Eigen::MatrixXd difference = (8.0 * (at(h) - at(-h)) - (at(2 * h) - at(-2 * h))) / (12.0 * h);
        for (Eigen::Index j = 0; j < d; ++j) {
            const double scale = unit(i) * unit(j);
            const Eigen::VectorXd column = exact.second_derivatives.col(i * d + j);
            worst = std::max(worst, (difference.col(j) - column).norm() * scale / (1.0 + column.norm() * scale));
            const Eigen::VectorXd mirrored = exact.second_derivatives.col(j * d + i);
            CHECK((mirrored - column).norm() * scale < 1e-9 * (1.0 + column.norm() * scale));
        }
    }
    return worst;
}

}  // namespace

TEST_CASE("second derivatives across turning points and sticking, in closed form", "[models][reference]") {
    // Released from rest at x0, after five half swings held at x0 - 8 c / w2. Measured at most 2.3e-12 here and at the
    // release, times ten.
    const double w2 = 4.0, c = 0.5;
    Eigen::VectorXd theta(4);
    theta << w2, c, 0.0, 1.0;
    const std::array<double, 2> durations{0.75 * pi, 100.0};
    const auto flow = oscillator().flow_with_second_derivatives(Eigen::Vector2d(1.1, 0.0), 0.0, durations, theta,
                                                                Free{0, 1}, Clock::time);
    REQUIRE(flow.status == FlowStatus::ok);
    CHECK(flow.crossings == 4);
    CHECK(flow.stickings == 1);
    const auto second = [&](Eigen::Index k, Eigen::Index i, Eigen::Index j) {
        return Eigen::Vector2d(flow.second_derivatives.col((k * 4 + i) * 4 + j));
    };
    for (Eigen::Index i = 0; i < 4; ++i)
        for (Eigen::Index j = 0; j < 4; ++j) {
            CAPTURE(i, j);
            // The start of a start at rest moves the instants of the turning points, but not where they are.
            double expected = 0.0;
            if (i == 2 && j == 2) expected = -16.0 * c / (w2 * w2 * w2);
            if (i + j == 5) expected = 8.0 / (w2 * w2);
            if (i == 1 && j == 1) continue;  // by the velocity of the start: not smooth at rest
            CHECK_THAT(second(1, i, j)[0], tests::WithinAbs(expected, 2.3e-11));
            CHECK(second(1, i, j)[1] == 0.0);
        }
    // Between the first and the second turning point x = -c/w2 + (x0 - 3 c/w2) cos(w t).
    const Function position = [&](const std::vector<long double>& p) {
        return -p[2] / p[1] +
               (p[0] - 3.0L * p[2] / p[1]) * std::cos(std::sqrt(p[1]) * 0.75L * static_cast<long double>(pi));
    };
    const std::vector<double> at{1.1, w2, c};
    const std::array<Eigen::Index, 3> direction{0, 2, 3};
    for (std::size_t i = 0; i < 3; ++i)
        for (std::size_t j = 0; j < 3; ++j) {
            CAPTURE(i, j);
            CHECK_THAT(second(0, direction[i], direction[j])[0],
                       tests::WithinAbs(second_difference(position, at, i, j), 2.3e-11));
        }
}

TEST_CASE("second derivatives after a release from sticking, in closed form", "[models][reference]") {
    // Held at x = 0 until cos(phase) = -c / b, then free and forced oscillation about c / w2, from rest.
    const double w2 = 4.0, c = 0.5, b = 0.9, omega = 1.5;
    const auto motion = [](const std::vector<long double>& p, long double time) -> std::array<long double, 2> {
        const long double w = std::sqrt(p[0]), turn = std::acos(-p[1] / p[2]);
        const long double forced = p[2] / (p[0] - p[3] * p[3]), offset = p[1] / p[0];
        const long double A = -offset - forced * std::cos(turn), B = forced * p[3] * std::sin(turn) / w;
        const long double since = time - turn / p[3];
        return {offset + forced * std::cos(p[3] * time) + A * std::cos(w * since) + B * std::sin(w * since),
                -forced * p[3] * std::sin(p[3] * time) - A * w * std::sin(w * since) + B * w * std::cos(w * since)};
    };
    Eigen::VectorXd theta(4);
    theta << w2, c, b, omega;
    const double until = std::acos(-c / b) / omega + 0.2;
    const std::array<double, 1> duration{until - 1.1};
    const auto flow = oscillator().flow_with_second_derivatives(Eigen::Vector2d::Zero(), 1.1 * omega, duration, theta,
                                                                Free{0, 1, 2, 3}, Clock::time);
    REQUIRE(flow.status == FlowStatus::ok);
    CHECK(flow.stickings == 1);
    // The phase of the start is held while omega moves: the clock then reads 1.1 omega / omega' at the start.
    for (std::size_t i = 0; i < 4; ++i)
        for (std::size_t j = 0; j < 4; ++j)
            for (std::size_t k = 0; k < 2; ++k) {
                CAPTURE(i, j, k);
                const Function value = [&](const std::vector<long double>& p) {
                    return motion(
                        p, 1.1L * static_cast<long double>(omega) / p[3] + (static_cast<long double>(until) - 1.1L))[k];
                };
                const auto column = static_cast<Eigen::Index>((i + 2) * 6 + j + 2);
                CHECK_THAT(flow.second_derivatives(static_cast<Eigen::Index>(k), column),
                           tests::WithinAbs(second_difference(value, {w2, c, b, omega}, i, j), 2.3e-11));
            }
}

TEST_CASE("second derivatives of the pendulum equal differences across crossings and sticking", "[models][fast]") {
    const auto system = make_system("parametric_pendulum");
    Eigen::VectorXd theta = system->default_parameters();
    theta[2] = 1e-3;
    const Free free{0, 1, 2, 3, 4, 5, 6, 7, 8};
    for (const Clock clock : {Clock::phase, Clock::time}) {
        CAPTURE(clock == Clock::phase);
        const double duration = clock == Clock::phase ? 6.5 : 0.7;
        // Measured at most 2e-10 over eleven directions, here and below, times ten.
        CHECK(difference_error(*system, Eigen::Vector2d(0.3, 2.0), 0.7, duration, theta, free, clock) < 2e-9);
        CHECK(difference_error(*system, Eigen::Vector2d(-1.0, 0.5), 0.7, duration, theta, free, clock) < 2e-9);
    }
    // Strong friction: sticks and lets go within the period.
    theta[2] = 0.1;
    const std::array<double, 1> period{2.0 * pi};
    const Eigen::Vector2d x0(0.4, 1.0);
    REQUIRE(system->flow(x0, 0.0, period, theta, Clock::phase).stickings > 0);
    CHECK(difference_error(*system, x0, 0.0, 6.5, theta, free, Clock::phase) < 2e-9);
    CHECK(difference_error(*system, x0, 0.0, 0.7, theta, free, Clock::time) < 2e-9);
}

TEST_CASE("second derivatives of iterates of a map", "[models][fast]") {
    // Two iterations of y = r x (1 - x): r^2 y0 (1 - r y0) with y0 = x (1 - x). Measured 6.5e-15, times ten.
    const auto system = make_system("logistic");
    const double x = 0.3, r = 3.7;
    const std::array<double, 1> durations{2.0};
    const auto flow = system->flow_with_second_derivatives(Eigen::VectorXd::Constant(1, x), 0.0, durations,
                                                           Eigen::VectorXd::Constant(1, r), Free{0}, Clock::time);
    REQUIRE(flow.status == FlowStatus::ok);
    const double y = x * (1.0 - x), y1 = 1.0 - 2.0 * x;
    const double by_y = r * r * (1.0 - 2.0 * r * y), by_y_twice = -2.0 * r * r * r;
    REQUIRE(flow.second_derivatives.cols() == 4);
    CHECK_THAT(flow.second_derivatives(0, 0), tests::WithinAbs(by_y_twice * y1 * y1 - 2.0 * by_y, 6.5e-14));
    const double mixed = (2.0 * r - 6.0 * r * r * y) * y1;
    CHECK_THAT(flow.second_derivatives(0, 1), tests::WithinAbs(mixed, 6.5e-14));
    CHECK_THAT(flow.second_derivatives(0, 2), tests::WithinAbs(mixed, 6.5e-14));
    CHECK_THAT(flow.second_derivatives(0, 3), tests::WithinAbs(2.0 * y - 6.0 * r * y * y, 6.5e-14));
}

}  // namespace orbid::models::second_order_test
