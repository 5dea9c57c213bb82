#include <Eigen/LU>
#include <cmath>
#include <numbers>

#include "models/catalogue/registry.hpp"
#include "models/kernels/model_system.hpp"
#include "tests/catch.hpp"
#include "tests/models/trajectories/dry_oscillator.hpp"

namespace orbid::models::switching_test {

using tests::DryOscillator;
using tests::WithinAbs;

namespace {

constexpr double pi = std::numbers::pi;

const System& oscillator() {
    static const ModelSystem<DryOscillator> system;
    return system;
}

Eigen::VectorXd theta_of(double w2, double c, double b, double omega) {
    Eigen::VectorXd theta(4);
    theta << w2, c, b, omega;
    return theta;
}

/// Worst difference between the sensitivities and central differences of the flow, relative to their size.
double difference_error(const System& system, const Eigen::VectorXd& x0, double phase, double duration,
                        const Eigen::VectorXd& theta, const std::vector<Eigen::Index>& free, Clock clock) {
    const std::array<double, 1> durations{duration};
    const auto exact = system.flow_with_sensitivities(x0, phase, durations, theta, free, clock);
    REQUIRE(exact.status == FlowStatus::ok);
    const Eigen::Index n = x0.size();
    double worst = 0.0;
    for (Eigen::Index j = 0; j < n + static_cast<Eigen::Index>(free.size()); ++j) {
        const auto at = [&](double step) -> Eigen::VectorXd {
            Eigen::VectorXd x = x0, p = theta;
            if (j < n)
                x[j] += step;
            else
                p[free[static_cast<std::size_t>(j - n)]] += step;
            return system.flow(x, phase, durations, p, clock).states.col(0);
        };
        const double size = j < n ? 1.0 : std::abs(theta[free[static_cast<std::size_t>(j - n)]]);
        const double h = 1e-4 * size;
        // Fourth order: error h^4 times the fifth derivative, rounding 1e-12 / h.
        const Eigen::VectorXd difference = (8.0 * (at(h) - at(-h)) - (at(2 * h) - at(-2 * h))) / (12.0 * h);
        worst = std::max(worst, (difference - exact.sensitivities.col(j)).norm() * size /
                                    (1.0 + exact.sensitivities.col(j).norm() * size));
    }
    return worst;
}

}  // namespace

TEST_CASE("a dry oscillator loses four times c / w^2 per period and sticks where the spring is too weak",
          "[models][reference]") {
    const double w2 = 4.0, c = 0.5, w = 2.0;
    const Eigen::VectorXd theta = theta_of(w2, c, 0.0, 1.0);
    // Released from rest at 1.1: half swings end at -(x - 2 c/w2): 1.1, -0.85, 0.6, -0.35, 0.1; |0.1| < c/w2 = 0.125.
    std::vector<double> durations;
    for (int i = 0; i <= 5; ++i)
        durations.push_back(i * pi / w);
    durations.push_back(100.0);
    const auto flow = oscillator().flow_with_sensitivities(Eigen::Vector2d(1.1, 0.0), 0.0, durations, theta,
                                                           std::array<Eigen::Index, 2>{0, 1}, Clock::time);
    REQUIRE(flow.status == FlowStatus::ok);
    CHECK(flow.crossings == 4);
    CHECK(flow.stickings == 1);
    const std::array<double, 7> turning{1.1, -0.85, 0.6, -0.35, 0.1, 0.1, 0.1};
    for (Eigen::Index k = 0; k < 7; ++k) {
        CAPTURE(k);
        // Tolerance 1e-12 per step, some fifty steps.
        CHECK_THAT(flow.states(0, k), WithinAbs(turning[static_cast<std::size_t>(k)], 1e-11));
        CHECK_THAT(flow.states(1, k), WithinAbs(0.0, 1e-10));
    }
    CHECK(flow.states(1, 6) == 0.0);
    // After sticking x = x0 - 8 c / w2: d/dx0 = 1, d/dv0 = 0 (a turning point), d/dw2 = 8 c / w2^2, d/dc = -8 / w2.
    const Eigen::MatrixXd d = flow.sensitivity(6, 4);
    CHECK_THAT(d(0, 0), WithinAbs(1.0, 1e-10));
    CHECK_THAT(d(0, 1), WithinAbs(0.0, 1e-10));
    CHECK_THAT(d(0, 2), WithinAbs(8.0 * c / (w2 * w2), 1e-10));
    CHECK_THAT(d(0, 3), WithinAbs(-8.0 / w2, 1e-10));
    CHECK(d.row(1).isZero(0.0));
    // At duration 0 nothing has happened yet.
    CHECK(flow.sensitivity(0, 4).leftCols(2).isIdentity(0.0));
    CHECK(oscillator().at_rest(flow.states.col(6), theta));
    CHECK_FALSE(oscillator().at_rest(Eigen::Vector2d(0.3, 0.0), theta));
}

TEST_CASE("the velocity derivative is multiplied by a+ / a- at a crossing", "[models][reference]") {
    // One crossing at x = -0.85 from x0 = 1.1: a- = -w2 x + c = 3.9, a+ = -w2 x - c = 2.9. In the plane (x, v / w) both
    // halves are rotations by w t about (+-c / w2, 0), with the factor between them.
    const double w = 2.0, c = 0.5;
    const Eigen::VectorXd theta = theta_of(w * w, c, 0.0, 1.0);
    const double first = 0.6, second = 0.7;
    const double x0 = 1.1;
    // Start on the way down at angle w first before the turning point.
    const double centre = c / 4.0, radius = x0 - centre;
    const Eigen::Vector2d start(centre + radius * std::cos(pi - w * first), -w * radius * std::sin(pi - w * first));
    const std::array<double, 1> duration{first + second};
    const auto flow = oscillator().flow_with_sensitivities(start, 0.0, duration, theta, {}, Clock::time);
    REQUIRE(flow.crossings == 1);
    const auto rotation = [&](double t) {
        Eigen::Matrix2d r;
        r << std::cos(w * t), std::sin(w * t) / w, -w * std::sin(w * t), std::cos(w * t);
        return r;
    };
    const Eigen::Matrix2d expected =
        rotation(second) * Eigen::Vector2d(1.0, (3.4 - 0.5) / (3.4 + 0.5)).asDiagonal() * rotation(first);
    CHECK((flow.sensitivities - expected).norm() < 1e-10);
}

TEST_CASE("sticking ends when the force exceeds the friction", "[models][reference]") {
    // Held at x = 0 while b |cos| <= c. From phase pi/2 the force grows towards -b: released when cos tau = -c / b.
    const double c = 0.5, b = 0.9, omega = 1.5;
    const Eigen::VectorXd theta = theta_of(4.0, c, b, omega);
    const double release = std::acos(-c / b) - pi / 2;
    const std::array<double, 3> durations{0.5 * release, 0.999 * release, release + 0.3};
    const std::vector<Eigen::Index> free{0, 1, 2, 3};
    const auto flow =
        oscillator().flow_with_sensitivities(Eigen::Vector2d(0.0, 0.0), pi / 2, durations, theta, free, Clock::phase);
    REQUIRE(flow.status == FlowStatus::ok);
    CHECK(flow.stickings == 1);
    CHECK(flow.states.leftCols(2).isZero(0.0));
    CHECK(flow.sensitivity(1, 6).row(1).isZero(0.0));
    // Afterwards x'' = -w2 x + c + b cos(omega t): free and forced oscillation about c / w2, from rest at x = 0.
    const double w = 2.0, t0 = (pi / 2 + release) / omega, t = 0.3 / omega;
    const double forced = b / (w * w - omega * omega);
    const double A = -c / (w * w) - forced * std::cos(omega * t0), B = forced * omega * std::sin(omega * t0) / w;
    const double x = c / (w * w) + forced * std::cos(omega * (t0 + t)) + A * std::cos(w * t) + B * std::sin(w * t);
    CHECK_THAT(flow.states(0, 2), WithinAbs(x, 1e-12));
    // A start that is held at another place, and all parameters, across the release. Measured at most 1.3e-11.
    CHECK(difference_error(oscillator(), Eigen::Vector2d(0.02, 0.3), 0.0, 7.0, theta, free, Clock::phase) < 1.3e-10);
    CHECK(difference_error(oscillator(), Eigen::Vector2d(0.02, 0.3), 0.0, 7.0, theta, free, Clock::time) < 1.3e-10);
    // A force that never suffices: held for ever, cheaply.
    const std::array<double, 1> long_time{1e6};
    const auto held =
        oscillator().flow(Eigen::Vector2d(0.1, 0.0), 0.0, long_time, theta_of(4.0, 0.5, 0.05, 1.0), Clock::phase);
    CHECK(held.status == FlowStatus::ok);
    CHECK(held.steps == 0);
    CHECK(oscillator().at_rest(Eigen::Vector2d(0.1, 0.0), theta_of(4.0, 0.5, 0.05, 1.0)));
    CHECK_FALSE(oscillator().at_rest(Eigen::Vector2d(0.1, 0.0), theta_of(4.0, 0.5, 0.15, 1.0)));
}

TEST_CASE("arriving on the surface without acceleration is grazing", "[models][reference]") {
    // w = 2, omega = b = 1, about phase 2 pi: v(s) = -sin(s) / 3 + sin(2 s) / 6 + lift cos(2 s) while v > 0. Without
    // lift velocity, acceleration and its derivative vanish together at s = 0: v = -s^3 / 6 + ...
    const double c = 0.5;
    const Eigen::VectorXd theta = theta_of(4.0, c, 1.0, 1.0);
    const auto start = [&](double lift) {
        return Eigen::Vector2d(-c / 4.0 + std::cos(1.0) / 3.0 - std::cos(2.0) / 12.0 - 0.5 * lift * std::sin(2.0),
                               std::sin(1.0) / 3.0 - std::sin(2.0) / 6.0 + lift * std::cos(2.0));
    };
    const double phase = 2.0 * pi - 1.0;
    const std::array<double, 1> duration{1.5};
    const FlowOptions fine{.relative_tolerance = 1e-14, .absolute_tolerance = 1e-14};
    // Below the surface by 2e-13, so that rounding cannot keep v above it: it arrives at s = -(1.2e-12)^(1/3) = -1e-4
    // with -s^2 / 2 = -6e-9, less than 1e-8 of the jump of 2 c = 1.
    for (const Clock clock : {Clock::time, Clock::phase}) {
        const auto grazing = oscillator().flow(start(-2e-13), phase, duration, theta, clock, fine);
        CHECK(grazing.status == FlowStatus::grazing);
        CHECK_THAT(grazing.stopped_after, WithinAbs(1.0, 2e-4));
        CHECK_THAT(grazing.stopped_state[0], WithinAbs(0.5 / 4.0, 1e-12));
        const auto with = oscillator().flow_with_sensitivities(start(-2e-13), phase, duration, theta, {}, clock, fine);
        CHECK(with.status == FlowStatus::grazing);
        // Arriving with an acceleration of some -0.03 is an ordinary crossing; here friction then holds.
        for (const double lift : {-2e-3, 2e-3}) {
            const auto crossing = oscillator().flow(start(lift), phase, duration, theta, clock, fine);
            CHECK(crossing.status == FlowStatus::ok);
            CHECK(crossing.crossings == 1);
            CHECK(crossing.stickings == 1);
        }
    }
    // In an ensemble one such trajectory does not stop the others.
    Eigen::MatrixXd starts(2, 2);
    starts << start(-2e-13), start(-2e-3);
    const auto ensemble = oscillator().ensemble(starts, phase, 1, theta, fine);
    CHECK(ensemble.status[0] == FlowStatus::grazing);
    CHECK(ensemble.sections[0].cols() == 1);
    CHECK(ensemble.status[1] == FlowStatus::ok);
}

TEST_CASE("both ends of a short reversal are found down to the accuracy of the velocity", "[models][reference]") {
    // w = 2, omega = b = 1, about phase 3 pi / 2: v(s) = cos(s) / 3 - (1 / 3 + depth) cos(2 s) while v > 0, near s = 0
    // v = -depth + s^2 / 2: negative for 2 sqrt(2 depth) seconds. The motion is reversed there (two crossings) or,
    // where the force at a zero is below the friction, held until the force has grown (one sticking in the place of a
    // crossing or before it). When the minimum lies above the surface by as much, nothing happens.
    // A dip can be told from a miss when it is deeper than the error of the velocity, some ten tolerances.
    const double c = 1e-3;
    const Eigen::VectorXd theta = theta_of(4.0, c, 1.0, 1.0);
    const std::array<double, 1> duration{2.0};
    std::size_t steps_of_coarsest = 0;
    for (const double tolerance : {1e-4, 1e-6, 1e-8, 1e-10, 1e-12})
        for (const double depth : {1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-11}) {
            if (depth < 9.0 * tolerance) continue;
            CAPTURE(tolerance, depth);
            const auto about = [&](double deep) {
                const Eigen::Vector2d start(-c / 4.0 - std::sin(1.0) / 3.0 + 0.5 * (1.0 / 3.0 + deep) * std::sin(2.0),
                                            std::cos(1.0) / 3.0 - (1.0 / 3.0 + deep) * std::cos(2.0));
                return oscillator().flow(start, 1.5 * pi - 1.0, duration, theta, Clock::time,
                                         {.relative_tolerance = tolerance, .absolute_tolerance = tolerance});
            };
            const auto dips = about(depth), misses = about(-depth);
            CHECK(dips.status == FlowStatus::ok);
            CHECK(dips.crossings + dips.stickings >= 2);
            CHECK(misses.status == FlowStatus::ok);
            CHECK(misses.crossings + misses.stickings == 0);
            if (steps_of_coarsest == 0) steps_of_coarsest = misses.steps;
        }
    // Steps of half a second and more: dips shallower than 1e-2, shorter than 0.3 s, begin and end within one.
    CHECK(steps_of_coarsest <= 4);
}

TEST_CASE("sensitivities of the pendulum equal differences across crossings and sticking", "[models][fast]") {
    const auto system = make_system("parametric_pendulum");
    Eigen::VectorXd theta = system->default_parameters();
    theta[2] = 1e-3;
    std::vector<Eigen::Index> free;
    for (Eigen::Index i = 0; i < 9; ++i)
        free.push_back(i);
    for (const Eigen::Vector2d& x0 :
         {Eigen::Vector2d(0.3, 2.0), Eigen::Vector2d(2.5, -8.0), Eigen::Vector2d(-1.0, 0.5)})
        for (const Clock clock : {Clock::phase, Clock::time}) {
            CAPTURE(x0[0], x0[1], clock == Clock::phase);
            const double duration = clock == Clock::phase ? 6.5 : 0.7;
            // Measured at most 8.8e-11 (over eleven directions), times ten.
            CHECK(difference_error(*system, x0, 0.7, duration, theta, free, clock) < 8.8e-10);
        }
    // Strong friction: sticks and lets go within the period.
    theta[2] = 0.1;
    const std::array<double, 1> period{2.0 * pi};
    const Eigen::Vector2d x0(0.4, 1.0);
    REQUIRE(system->flow(x0, 0.0, period, theta, Clock::phase).stickings > 0);
    for (const Clock clock : {Clock::phase, Clock::time})
        // Measured at most 3.5e-12, times ten.
        CHECK(difference_error(*system, x0, 0.0, clock == Clock::phase ? 6.5 : 0.7, theta, free, clock) < 3.5e-11);
    const auto stuck = system->flow_with_sensitivities(x0, 0.0, period, theta, {}, Clock::phase);
    CHECK_THAT(stuck.sensitivities.determinant(), WithinAbs(0.0, 1e-15));
}

TEST_CASE("starts on the switching surface", "[models][fast]") {
    const auto system = make_system("parametric_pendulum");
    Eigen::VectorXd theta = system->default_parameters();
    const std::array<double, 1> periods{20.0 * pi};
    for (const double phi : {0.0, pi, -pi, 1.0, -1.0, 3.0}) {
        CAPTURE(phi);
        const auto flow = system->flow(Eigen::Vector2d(phi, 0.0), 0.0, periods, theta, Clock::phase);
        CHECK(flow.status == FlowStatus::ok);
        CHECK(flow.steps < 2000);
    }
    CHECK(system->at_rest(Eigen::Vector2d(0.0, 0.0), theta));
    CHECK(system->at_rest(Eigen::Vector2d(pi, 0.0), theta));
    CHECK_FALSE(system->at_rest(Eigen::Vector2d(1.0, 0.0), theta));
    // Resting states with k1 = 1e-3: |phi| < 0.00196 rad, k1 / (m l^2) over the largest |P|.
    theta[2] = 1e-3;
    CHECK(system->at_rest(Eigen::Vector2d(0.0019, 0.0), theta));
    CHECK_FALSE(system->at_rest(Eigen::Vector2d(0.0020, 0.0), theta));
    CHECK(system->flow(Eigen::Vector2d(0.0019, 0.0), 0.0, periods, theta, Clock::phase).states(0, 0) == 0.0019);
}

}  // namespace orbid::models::switching_test
