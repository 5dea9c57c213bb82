#pragma once

#include <cmath>
#include <complex>
#include <numbers>
#include <stdexcept>
#include <utility>
#include <vector>

#include "models/system/system.hpp"

namespace orbid::tests {

using Complex = std::complex<double>;

/// A system whose flow is a formula. Derivatives by the complex step, exact to rounding for analytic formulas.
class ClosedFormSystem : public models::System {
public:
    /// State after a duration (in the phase for forced systems, in steps for maps).
    [[nodiscard]] virtual Eigen::VectorXcd advance(const Eigen::VectorXcd& x0, double phase, double duration,
                                                   const Eigen::VectorXcd& theta) const = 0;

    [[nodiscard]] std::string_view name() const override { return "closed form"; }
    [[nodiscard]] std::string_view variant() const override { return ""; }
    [[nodiscard]] models::Kind kind() const override { return kind_; }
    [[nodiscard]] std::span<const models::Coordinate> coordinates() const override { return coordinates_; }
    [[nodiscard]] std::span<const models::Parameter> parameters() const override { return parameters_; }
    [[nodiscard]] std::optional<models::Symmetry> symmetry() const override { return std::nullopt; }
    [[nodiscard]] bool smooth(const Eigen::VectorXd&) const override { return true; }
    [[nodiscard]] double period(const Eigen::VectorXd&, models::Clock) const override {
        return 2.0 * std::numbers::pi;  // only ever asked for in the phase
    }
    [[nodiscard]] bool at_rest(const Eigen::VectorXd&, const Eigen::VectorXd&) const override { return false; }
    [[nodiscard]] Eigen::MatrixXd rhs(const Eigen::MatrixXd&, std::span<const double>,
                                      const Eigen::VectorXd&) const override {
        throw std::logic_error("not needed");
    }
    [[nodiscard]] models::FlowResult flow(const Eigen::VectorXd& x0, double phase, std::span<const double> durations,
                                          const Eigen::VectorXd& theta, models::Clock,
                                          const models::FlowOptions& = {}) const override {
        models::FlowResult result;
        result.states.resize(x0.size(), static_cast<Eigen::Index>(durations.size()));
        for (std::size_t k = 0; k < durations.size(); ++k)
            result.states.col(static_cast<Eigen::Index>(k)) =
                advance(x0.cast<Complex>(), phase, durations[k], theta.cast<Complex>()).real();
        if (!result.states.allFinite()) result.status = models::FlowStatus::not_finite;
        return result;
    }
    [[nodiscard]] models::FlowResult flow_with_sensitivities(const Eigen::VectorXd& x0, double phase,
                                                             std::span<const double> durations,
                                                             const Eigen::VectorXd& theta,
                                                             std::span<const Eigen::Index> free, models::Clock clock,
                                                             const models::FlowOptions& options = {}) const override {
        models::FlowResult result = flow(x0, phase, durations, theta, clock, options);
        constexpr double h = 1e-100;  // squares of it vanish beside 1
        const Eigen::Index n = x0.size();
        const Eigen::Index d = n + static_cast<Eigen::Index>(free.size());
        result.sensitivities.resize(n, d * static_cast<Eigen::Index>(durations.size()));
        for (std::size_t k = 0; k < durations.size(); ++k)
            for (Eigen::Index i = 0; i < d; ++i) {
                Eigen::VectorXcd x = x0.cast<Complex>();
                Eigen::VectorXcd values = theta.cast<Complex>();
                (i < n ? x(i) : values(free[static_cast<std::size_t>(i - n)])) += Complex(0.0, h);
                result.sensitivities.col(static_cast<Eigen::Index>(k) * d + i) =
                    advance(x, phase, durations[k], values).imag() / h;
            }
        return result;
    }
    [[nodiscard]] models::ReadingResult readings(const models::Sensor&, const Eigen::MatrixXd&, std::span<const double>,
                                                 const Eigen::VectorXd&, std::optional<std::span<const Eigen::Index>>,
                                                 const models::FlowOptions& = {}) const override {
        throw std::logic_error("not needed");
    }
    [[nodiscard]] models::EnsembleResult ensemble(const Eigen::MatrixXd&, double, std::size_t, const Eigen::VectorXd&,
                                                  const models::FlowOptions& = {}) const override {
        throw std::logic_error("not needed");
    }

protected:
    ClosedFormSystem(models::Kind kind, std::vector<models::Coordinate> coordinates,
                     std::vector<models::Parameter> parameters)
        : kind_(kind), coordinates_(std::move(coordinates)), parameters_(std::move(parameters)) {}

private:
    models::Kind kind_;
    std::vector<models::Coordinate> coordinates_;
    std::vector<models::Parameter> parameters_;
};

/// x' = 1 - a x^2 + y, y' = b x.
class HenonMap : public ClosedFormSystem {
public:
    HenonMap()
        : ClosedFormSystem(models::Kind::map, {models::real("x", ""), models::real("y", "")},
                           {{"a", "", models::any_real, 1.4, ""}, {"b", "", models::any_real, 0.3, ""}}) {}
    [[nodiscard]] Eigen::VectorXcd advance(const Eigen::VectorXcd& x0, double, double duration,
                                           const Eigen::VectorXcd& theta) const override {
        Eigen::VectorXcd x = x0;
        for (int k = 0; k < static_cast<int>(std::lround(duration)); ++k)
            x = Eigen::Vector2cd(1.0 - theta(0) * x(0) * x(0) + x(1), theta(1) * x(0));
        return x;
    }
};

/// x' = x^2 + c: fixed points (1 +- sqrt(1 - 4 c)) / 2 with multipliers 2 x, none for c > 1/4. c = -2 is the logistic
/// map with r = 4: a prime cycle of period p has the multiplier +-2^p, the fixed point x = 2 has 4.
class QuadraticMap : public ClosedFormSystem {
public:
    QuadraticMap()
        : ClosedFormSystem(models::Kind::map, {models::real("x", "")}, {{"c", "", models::any_real, -2.0, ""}}) {}
    [[nodiscard]] Eigen::VectorXcd advance(const Eigen::VectorXcd& x0, double, double duration,
                                           const Eigen::VectorXcd& theta) const override {
        Eigen::VectorXcd x = x0;
        for (int k = 0; k < static_cast<int>(std::lround(duration)); ++k)
            x(0) = x(0) * x(0) + theta(0);
        return x;
    }
};

/// Dissipative standard map on the cylinder: v' = b v + k sin(phi) + w, phi' = phi + v' (phi an angle).
/// Fixed points with rotation r: v = 2 pi r, sin(phi) = (2 pi r (1 - b) - w) / k.
class StandardMap : public ClosedFormSystem {
public:
    StandardMap()
        : ClosedFormSystem(models::Kind::map, {models::angle("phi", "rad"), models::real("v", "rad")},
                           {{"b", "", models::any_real, 0.4, ""},
                            {"k", "", models::any_real, 5.0, ""},
                            {"w", "", models::any_real, 0.3, ""}}) {}
    [[nodiscard]] Eigen::VectorXcd advance(const Eigen::VectorXcd& x0, double, double duration,
                                           const Eigen::VectorXcd& theta) const override {
        Eigen::VectorXcd x = x0;
        for (int k = 0; k < static_cast<int>(std::lround(duration)); ++k) {
            const Complex v = theta(0) * x(1) + theta(1) * std::sin(x(0)) + theta(2);
            x = Eigen::Vector2cd(x(0) + v, v);
        }
        return x;
    }
};

/// x'' + c x' + w0sq x = a cos(omega t), underdamped; phase tau = omega t.
class ForcedOscillator : public ClosedFormSystem {
public:
    ForcedOscillator()
        : ClosedFormSystem(models::Kind::forced, {models::real("x", "m"), models::real("v", "m/s")},
                           {{"w0sq", "1/s^2", models::positive, 3.0, ""},
                            {"c", "1/s", models::nonnegative, 0.4, ""},
                            {"a", "m/s^2", models::any_real, 1.7, ""},
                            {"omega", "rad/s", models::positive, 2.3, ""}}) {}

    /// The periodic solution at a phase.
    [[nodiscard]] static Eigen::Vector2cd steady(double phase, const Eigen::VectorXcd& theta) {
        const Complex detuning = theta(0) - theta(3) * theta(3);
        const Complex damping = theta(1) * theta(3);
        const Complex square = detuning * detuning + damping * damping;
        const Complex in_phase = theta(2) * detuning / square;
        const Complex quadrature = theta(2) * damping / square;
        return {in_phase * std::cos(phase) + quadrature * std::sin(phase),
                theta(3) * (quadrature * std::cos(phase) - in_phase * std::sin(phase))};
    }
    [[nodiscard]] double period(const Eigen::VectorXd& theta, models::Clock clock) const override {
        return 2.0 * std::numbers::pi / (clock == models::Clock::time ? theta(3) : 1.0);
    }
    [[nodiscard]] Eigen::MatrixXd rhs(const Eigen::MatrixXd& states, std::span<const double> phases,
                                      const Eigen::VectorXd& theta) const override {
        Eigen::MatrixXd f(2, states.cols());
        for (Eigen::Index k = 0; k < states.cols(); ++k)
            f.col(k) << states(1, k), theta(2) * std::cos(phases[static_cast<std::size_t>(k)]) -
                                          theta(0) * states(0, k) - theta(1) * states(1, k);
        return f;
    }
    [[nodiscard]] Eigen::VectorXcd advance(const Eigen::VectorXcd& x0, double phase, double duration,
                                           const Eigen::VectorXcd& theta) const override {
        const Complex sigma = 0.5 * theta(1);
        const Complex frequency = std::sqrt(theta(0) - sigma * sigma);
        const Complex time = duration / theta(3);
        const Eigen::Vector2cd u = x0 - steady(phase, theta);
        const Complex decay = std::exp(-sigma * time);
        const Complex cosine = std::cos(frequency * time);
        const Complex sine = std::sin(frequency * time) / frequency;
        return steady(phase + duration, theta) +
               decay * Eigen::Vector2cd(u(0) * cosine + (u(1) + sigma * u(0)) * sine,
                                        u(1) * cosine - (sigma * u(1) + theta(0) * u(0)) * sine);
    }
};

/// Hopf's normal form, q' = w p + q (mu - q^2 - p^2), p' = -w q + p (mu - q^2 - p^2): the radius obeys r' = r (mu -
/// r^2) and the angle turns at -w. Cycle of radius sqrt(mu) with T = 2 pi / w, multipliers 1 and exp(-2 mu T).
class HopfNormalForm : public ClosedFormSystem {
public:
    HopfNormalForm()
        : ClosedFormSystem(models::Kind::autonomous, {models::real("q", ""), models::real("p", "")},
                           {{"mu", "1/s", models::any_real, 1.0, ""}, {"w", "rad/s", models::positive, 1.0, ""}}) {}
    [[nodiscard]] Eigen::MatrixXd rhs(const Eigen::MatrixXd& states, std::span<const double>,
                                      const Eigen::VectorXd& theta) const override {
        Eigen::MatrixXd f(2, states.cols());
        for (Eigen::Index k = 0; k < states.cols(); ++k) {
            const double growth = theta(0) - states.col(k).squaredNorm();
            f.col(k) << theta(1) * states(1, k) + states(0, k) * growth,
                -theta(1) * states(0, k) + states(1, k) * growth;
        }
        return f;
    }
    [[nodiscard]] Eigen::MatrixXd rhs_derivatives(const Eigen::MatrixXd& states, std::span<const double>,
                                                  const Eigen::VectorXd& theta,
                                                  std::span<const Eigen::Index> free) const override {
        const auto d = 2 + static_cast<Eigen::Index>(free.size());
        Eigen::MatrixXd derivatives(2, states.cols() * d);
        for (Eigen::Index k = 0; k < states.cols(); ++k) {
            const double q = states(0, k), p = states(1, k), growth = theta(0) - q * q - p * p;
            derivatives.middleCols(k * d, 2) << growth - 2.0 * q * q, theta(1) - 2.0 * q * p, -theta(1) - 2.0 * q * p,
                growth - 2.0 * p * p;
            for (Eigen::Index j = 2; j < d; ++j)
                derivatives.col(k * d + j) =
                    free[static_cast<std::size_t>(j - 2)] == 0 ? Eigen::Vector2d(q, p) : Eigen::Vector2d(p, -q);
        }
        return derivatives;
    }
    [[nodiscard]] Eigen::VectorXcd advance(const Eigen::VectorXcd& x0, double, double duration,
                                           const Eigen::VectorXcd& theta) const override {
        const Complex square = x0(0) * x0(0) + x0(1) * x0(1);
        const Complex decay = std::exp(-2.0 * theta(0) * duration);
        const Complex stretch = std::sqrt(theta(0) / (square + (theta(0) - square) * decay));
        const Complex cosine = std::cos(theta(1) * duration);
        const Complex sine = std::sin(theta(1) * duration);
        return stretch * Eigen::Vector2cd(x0(0) * cosine + x0(1) * sine, x0(1) * cosine - x0(0) * sine);
    }
};

/// x' = v, y' = -y: no orbit closes, and nothing rests.
class Drift : public ClosedFormSystem {
public:
    Drift()
        : ClosedFormSystem(models::Kind::autonomous, {models::real("x", ""), models::real("y", "")},
                           {{"v", "1/s", models::positive, 1.0, ""}}) {}
    [[nodiscard]] Eigen::MatrixXd rhs(const Eigen::MatrixXd& states, std::span<const double>,
                                      const Eigen::VectorXd& theta) const override {
        Eigen::MatrixXd f(2, states.cols());
        f.row(0).setConstant(theta(0));
        f.row(1) = -states.row(1);
        return f;
    }
    [[nodiscard]] Eigen::VectorXcd advance(const Eigen::VectorXcd& x0, double, double duration,
                                           const Eigen::VectorXcd& theta) const override {
        return Eigen::Vector2cd(x0(0) + theta(0) * duration, x0(1) * std::exp(-duration));
    }
};

}  // namespace orbid::tests
