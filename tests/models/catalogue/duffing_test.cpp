#include "models/catalogue/duffing.hpp"

#include <cmath>
#include <numbers>

#include "models/catalogue/registry.hpp"
#include "models/ensembles/pack_steps.hpp"
#include "tests/catch.hpp"
#include "tests/models/catalogue/lyapunov.hpp"

namespace orbid::models::duffing_test {

static_assert(TabulatedModel<Duffing> && SymmetricModel<Duffing>);

using tests::WithinAbs;

TEST_CASE("a linear oscillator under harmonic force follows its closed form with derivatives", "[models][reference]") {
    const auto system = make_system("duffing");
    const double delta = 0.4, alpha = 4.0, gamma = 1.5, omega = 1.7, phase = 0.6;
    Eigen::VectorXd theta(5);
    theta << delta, alpha, 0.0, gamma, omega;
    // x = e^(-delta t / 2) (a cos wt + b sin wt) + gamma Re[e^(i tau) / (alpha - omega^2 + i delta omega)]
    const auto solution = [&](double t, double x, double v) {
        const double w = std::sqrt(alpha - delta * delta / 4.0);
        const double re = alpha - omega * omega, im = delta * omega, size = re * re + im * im;
        const auto forced = [&](double tau) {
            return Eigen::Vector2d(gamma * (re * std::cos(tau) + im * std::sin(tau)) / size,
                                   gamma * omega * (im * std::cos(tau) - re * std::sin(tau)) / size);
        };
        const Eigen::Vector2d free = Eigen::Vector2d(x, v) - forced(phase);
        const double a = free[0], b = (free[1] + delta / 2.0 * a) / w;
        const double e = std::exp(-delta * t / 2.0), c = std::cos(w * t), s = std::sin(w * t);
        Eigen::Vector2d y(e * (a * c + b * s), e * ((b * w - delta / 2.0 * a) * c - (a * w + delta / 2.0 * b) * s));
        return Eigen::Vector2d(y + forced(phase + omega * t));
    };
    const std::vector<double> durations{1.0, 7.0};
    const auto flow = system->flow_with_sensitivities(Eigen::Vector2d(0.8, -0.3), phase, durations, theta,
                                                      std::vector<Eigen::Index>{3}, Clock::time);
    for (Eigen::Index k = 0; k < 2; ++k) {
        const double t = durations[static_cast<std::size_t>(k)];
        const Eigen::Vector2d x = solution(t, 0.8, -0.3);
        CHECK((flow.states.col(k) - x).norm() < 1e-11);
        // Linear in the start and in gamma: differences are exact.
        CHECK((flow.sensitivity(k, 3).col(0) - (solution(t, 1.8, -0.3) - x)).norm() < 1e-10);
        CHECK((flow.sensitivity(k, 3).col(1) - (solution(t, 0.8, 0.7) - x)).norm() < 1e-10);
        const Eigen::Vector2d from_rest = solution(t, 0.0, 0.0);
        CHECK((flow.sensitivity(k, 3).col(2) - from_rest / gamma).norm() < 1e-10);
    }
}

TEST_CASE("free swings with a cubic spring have the periods of elliptic functions", "[models][reference]") {
    // Released from rest at X: x = X cn(w t), w^2 = alpha + beta X^2, k^2 = beta X^2 / (2 w^2), so T = 4 K(k) / w where
    // k < 1; within one of two wells x = X dn(w t), w^2 = beta X^2 / 2, k^2 = 2 (1 + alpha / (beta X^2)), T = 2 K(k) /
    // w.
    struct Case {
        double alpha, X;
    };
    const auto system = make_system("duffing");
    for (const auto& [alpha, X] : {Case{1.0, 1.5}, Case{0.0, 1.0}, Case{-1.0, 1.6}, Case{-1.0, 1.2}}) {
        CAPTURE(alpha, X);
        const bool within = alpha + X * X / 2.0 < 0.0;
        const double w = std::sqrt(within ? X * X / 2.0 : alpha + X * X);
        const double k = std::sqrt(within ? 2.0 * (1.0 + alpha / (X * X)) : X * X / (2.0 * w * w));
        const double period = (within ? 2.0 : 4.0) * std::comp_ellint_1(k) / w;
        Eigen::VectorXd theta(5);
        theta << 0.0, alpha, 1.0, 0.0, 1.0;
        const auto flow =
            system->flow(Eigen::Vector2d(X, 0.0), 0.0, std::array{0.5 * period, period}, theta, Clock::time);
        // Some fifty steps with a local error of 1e-12.
        CHECK((flow.states.col(1) - Eigen::Vector2d(X, 0.0)).norm() < 1e-10);
        const double half = within ? std::sqrt(-2.0 * alpha - X * X) : -X;
        CHECK((flow.states.col(0) - Eigen::Vector2d(half, 0.0)).norm() < 1e-10);
    }
    // K(1 / sqrt 2) = Gamma(1/4)^2 / (4 sqrt pi): the purely cubic spring, independent of std::comp_ellint_1.
    CHECK_THAT(std::comp_ellint_1(std::sqrt(0.5)),
               WithinAbs(std::pow(std::tgamma(0.25), 2) / (4.0 * std::sqrt(std::numbers::pi)), 1e-14));
}

TEST_CASE("Ueda's oscillator has its Lyapunov exponent", "[models][reference]") {
    // x'' + 0.05 x' + x^3 = 7.5 cos t (Y. Ueda, Journal of Statistical Physics 20:181-196, 1979): 0.0999 (J. C. Sprott,
    // Chaos and Time-Series Analysis, 2003).
    const auto system = make_system("duffing");
    Eigen::VectorXd theta(5);
    theta << 0.05, 0.0, 1.0, 7.5, 1.0;
    const double period = 2.0 * std::numbers::pi;
    const auto exponent =
        tests::largest_exponent(*system, Eigen::Vector2d(2.5, 0.0), theta, period, 40, 25, Clock::time);
    CHECK(exponent.standard_error < 0.005);
    CHECK_THAT(exponent.mean, WithinAbs(0.0999, 4.0 * exponent.standard_error));
}

}  // namespace orbid::models::duffing_test
