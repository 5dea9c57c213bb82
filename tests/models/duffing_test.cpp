#include <cmath>

#include "models/registry.hpp"
#include "tests/catch.hpp"

namespace orbid::models {

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

}  // namespace orbid::models
