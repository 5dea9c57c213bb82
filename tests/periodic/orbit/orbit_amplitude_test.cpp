// Amplitudes of orbits against closed forms, and of a relaxation oscillation against another integrator.

#include <cmath>
#include <numbers>

#include "models/catalogue/registry.hpp"
#include "periodic/orbit/orbit.hpp"
#include "periodic/orbit/orbit_amplitude.hpp"
#include "tests/catch.hpp"
#include "tests/periodic/orbit/closed_form_system.hpp"

namespace orbid::periodic::orbit_amplitude_test {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::Vector2d;
using Eigen::VectorXd;
constexpr double pi = std::numbers::pi;

PeriodicOrbit orbit_through(const MatrixXd& points, double time) {
    PeriodicOrbit orbit;
    orbit.points = points;
    orbit.period = static_cast<int>(points.cols());
    orbit.time = time;
    return orbit;
}

/// phi = phi_0 + turns tau + 0.1 cos(tau), v constant; tau' = omega = 1.
class Carousel : public tests::ClosedFormSystem {
public:
    explicit Carousel(double turns)
        : ClosedFormSystem(models::Kind::forced, {models::angle("phi", "rad"), models::real("v", "1")},
                           {{"omega", "rad/s", models::positive, 1.0, ""}}),
          turns_(turns) {}
    [[nodiscard]] MatrixXd rhs(const MatrixXd& states, std::span<const double> phases, const VectorXd&) const override {
        MatrixXd f = MatrixXd::Zero(2, states.cols());
        for (Index k = 0; k < states.cols(); ++k)
            f(0, k) = turns_ - 0.1 * std::sin(phases[static_cast<std::size_t>(k)]);
        return f;
    }
    [[nodiscard]] Eigen::VectorXcd advance(const Eigen::VectorXcd& x0, double phase, double duration,
                                           const Eigen::VectorXcd&) const override {
        return Eigen::Vector2cd(x0(0) + turns_ * duration + 0.1 * (std::cos(phase + duration) - std::cos(phase)),
                                x0(1));
    }

private:
    double turns_;
};

}  // namespace

TEST_CASE("the amplitude of a forced oscillation of one harmonic", "[periodic][reference]") {
    const tests::ForcedOscillator system;
    const VectorXd theta = system.default_parameters();
    const auto at = [&](double phase) { return tests::ForcedOscillator::steady(phase, theta.cast<tests::Complex>()); };
    const double time = 2.0 * pi / theta(3);
    const double x = theta(2) / std::hypot(theta(0) - theta(3) * theta(3), theta(1) * theta(3));
    const Vector2d expected(x, theta(3) * x);
    // Once around, and twice as an orbit of two points.
    MatrixXd two(2, 2);
    two << at(0.7).real(), at(0.7).real();
    for (const PeriodicOrbit& orbit : {orbit_through(two.leftCols(1), time), orbit_through(two, 2.0 * time)}) {
        const OrbitAmplitude amplitude = amplitude_of(system, theta, 0.7, orbit, {});
        CAPTURE(orbit.period);
        CHECK((amplitude.maximum - expected).norm() < 1e-10 * x);
        CHECK((amplitude.minimum + expected).norm() < 1e-10 * x);
        CHECK((amplitude.half_range - expected).norm() < 1e-10 * x);
        CHECK((amplitude.rms - expected / std::sqrt(2.0)).norm() < 1e-13 * x);
        CHECK(amplitude.mean.norm() < 1e-13 * x);
    }
}

TEST_CASE("the amplitude of a cycle without a clock, and of a map's", "[periodic][reference]") {
    const tests::HopfNormalForm circle;
    const OrbitAmplitude round =
        amplitude_of(circle, Vector2d(0.25, 2.0), 0.0, orbit_through(Vector2d(0.5, 0.0), pi), {});
    CHECK((round.maximum - Vector2d(0.5, 0.5)).norm() < 1e-10);
    CHECK((round.minimum + Vector2d(0.5, 0.5)).norm() < 1e-10);
    CHECK((round.rms - Vector2d(0.5, 0.5) / std::sqrt(2.0)).norm() < 1e-13);
    // x^2 - 1: 0, -1, 0, ...
    const tests::QuadraticMap map;
    MatrixXd points(1, 2);
    points << 0.0, -1.0;
    const OrbitAmplitude pair = amplitude_of(map, VectorXd::Constant(1, -1.0), 0.0, orbit_through(points, 2.0), {});
    CHECK(pair.maximum(0) == 0.0);
    CHECK(pair.minimum(0) == -1.0);
    CHECK(pair.mean(0) == -0.5);
    CHECK(pair.half_range(0) == 0.5);
    CHECK(pair.rms(0) == std::sqrt(0.5));
}

TEST_CASE("angles that turn around have no amplitude, others one about a mean in one turn", "[periodic][reference]") {
    const VectorXd theta = VectorXd::Ones(1);
    const PeriodicOrbit orbit = orbit_through(Vector2d(2.0 * pi + 1.1, 3.0), 2.0 * pi);
    const OrbitAmplitude swinging = amplitude_of(Carousel(0.0), theta, 0.0, orbit, {});
    CHECK_THAT(swinging.mean(0), tests::WithinAbs(1.0, 1e-13));
    CHECK_THAT(swinging.maximum(0), tests::WithinAbs(1.1, 1e-11));
    CHECK_THAT(swinging.minimum(0), tests::WithinAbs(0.9, 1e-11));
    const OrbitAmplitude turning = amplitude_of(Carousel(1.0), theta, 0.0, orbit, {});
    CHECK(std::isnan(turning.mean(0)));
    CHECK(std::isnan(turning.maximum(0)));
    CHECK(turning.mean(1) == 3.0);
    CHECK(turning.half_range(1) == 0.0);
}

TEST_CASE("the amplitude of a relaxation oscillation", "[periodic][reference]") {
    // mu = 5, by SciPy 1.10 (DOP853 to 1e-13): the squares integrated with the orbit, the extremes as its events.
    const auto system = models::make_system("van_der_pol");
    const OrbitAmplitude amplitude =
        amplitude_of(*system, VectorXd::Constant(1, 5.0), 0.0,
                     orbit_through(Vector2d(2.0215080615623298, 0.0), 11.612230667719604), {});
    CHECK_THAT(amplitude.maximum(0), tests::WithinAbs(2.0215080615623, 1e-10));
    CHECK_THAT(amplitude.minimum(0), tests::WithinAbs(-2.0215080615623, 1e-10));
    CHECK_THAT(amplitude.maximum(1), tests::WithinAbs(7.637158827386, 1e-9));
    CHECK_THAT(amplitude.rms(0), tests::WithinAbs(1.572182842174, 1e-10));
    CHECK_THAT(amplitude.rms(1), tests::WithinAbs(1.572182842174, 1e-10));
    CHECK_THAT(amplitude.mean(0), tests::WithinAbs(0.0, 1e-10));
}

}  // namespace orbid::periodic::orbit_amplitude_test
