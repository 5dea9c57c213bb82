#include "models/catalogue/landing_gear_damper.hpp"

#include <cmath>
#include <numbers>

#include "models/catalogue/registry.hpp"
#include "models/ensembles/pack_steps.hpp"
#include "tests/catch.hpp"

namespace orbid::models::landing_gear_damper_test {

static_assert(TabulatedModel<StrutOnHarmonicBase> && SwitchingModel<StrutOnHarmonicBase>);

using tests::WithinAbs;
using tests::WithinRel;

namespace {

constexpr double pi = std::numbers::pi;

/// The strut with chosen friction, oil and ground.
struct Rig {
    std::shared_ptr<const System> system = make_system("landing_gear_damper");
    Eigen::VectorXd theta = system->default_parameters();

    double& operator[](std::string_view name) { return theta[system->parameter_index(name)]; }

    /// Where the gas carries the weight: p0 area (V0 / (V0 - area s))^kappa = m g.
    double static_stroke() {
        Rig& p = *this;
        return p["V0"] / p["area"] * (1.0 - std::pow(p["p0"] * p["area"] / (p["m"] * p["g"]), 1.0 / p["kappa"]));
    }
    /// Of small free swings: omega^2 = (dF_gas / ds) / m = kappa g / (V0 / area - s) there.
    double natural_frequency() {
        Rig& p = *this;
        return std::sqrt(p["kappa"] * p["g"] / (p["V0"] / p["area"] - static_stroke()));
    }
    /// Kinetic energy, work stored in the gas (polytropic, kappa > 1) and height.
    double energy(const Eigen::Vector2d& x) {
        Rig& p = *this;
        const double compression = 1.0 - p["area"] * x[0] / p["V0"];
        return 0.5 * p["m"] * x[1] * x[1] +
               p["p0"] * p["V0"] / (p["kappa"] - 1.0) * (std::pow(compression, 1.0 - p["kappa"]) - 1.0) -
               p["m"] * p["g"] * x[0];
    }
};

}  // namespace

TEST_CASE("a strut stands and swings as its gas spring says", "[models][reference]") {
    Rig strut;
    strut["friction"] = strut["amplitude"] = 0.0;
    const double stroke = strut.static_stroke(), omega = strut.natural_frequency();
    // Round numbers of the defaults: 0.142 m, 2.2 Hz.
    CHECK_THAT(stroke, WithinAbs(0.142, 5e-4));
    CHECK_THAT(omega / (2.0 * pi), WithinAbs(2.2, 0.05));
    // Rounding of 9.81.
    CHECK(std::abs(strut.system->rhs(Eigen::Vector2d(stroke, 0.0), std::array{0.3}, strut.theta)(1, 0)) < 1e-13);
    // Quadratic damping has no derivative at rest: X is a rotation in (s, s' / omega).
    for (const double part : {0.125, 0.5, 1.0}) {
        const double turn = 2.0 * pi * part;
        const auto flow = strut.system->flow_with_sensitivities(Eigen::Vector2d(stroke, 0.0), 0.0,
                                                                std::array{turn / omega}, strut.theta, {}, Clock::time);
        REQUIRE(flow.status == FlowStatus::ok);
        Eigen::Matrix2d rotation;
        rotation << std::cos(turn), std::sin(turn) / omega, -omega * std::sin(turn), std::cos(turn);
        // A few steps with a local error of 1e-11 of a column of size omega = 14 each.
        CHECK((flow.sensitivities - rotation).norm() < 1e-9);
    }
}

TEST_CASE("oil brakes compression and rebound by its own coefficients", "[models][reference]") {
    // Next to no gas, no weight: s'' = -(c / m) s'|s'|, so s' = v / (1 + c |v| t / m).
    Rig strut;
    strut["friction"] = strut["amplitude"] = strut["g"] = 0.0;
    strut["p0"] = 1e-20;
    const double m = strut["m"], t = 0.1;
    for (const double v : {0.7, -0.7}) {
        const double c = v > 0.0 ? strut["c_compression"] : strut["c_rebound"];
        const auto flow = strut.system->flow(Eigen::Vector2d(0.05, v), 0.0, std::array{t}, strut.theta, Clock::time);
        const double slowing = 1.0 + c * std::abs(v) * t / m;
        // A dozen steps with a local error of 1e-12.
        CHECK_THAT(flow.states(1, 0), WithinAbs(v / slowing, 1e-11));
        CHECK_THAT(flow.states(0, 0), WithinAbs(0.05 + std::copysign(m / c * std::log(slowing), v), 1e-11));
    }
}

TEST_CASE("what a shaken strut takes up goes into friction and oil", "[models][reference]") {
    // Over two periods, with dense samples: E(2 T) - E(0) = integral of force times velocity, by Simpson's
    // rule; in the frame of the ground the ground's acceleration acts as a force -m amplitude omega^2 cos(omega t).
    Rig strut;
    for (const double friction : {0.0, 300.0}) {
        CAPTURE(friction);
        strut["friction"] = friction;
        constexpr Eigen::Index samples = 40000;
        const double omega = strut["omega"], period = 2.0 * pi / omega, h = 2.0 * period / samples;
        std::vector<double> durations;
        for (Eigen::Index i = 0; i <= samples; ++i)
            durations.push_back(static_cast<double>(i) * h);
        const auto flow = strut.system->flow(Eigen::Vector2d(strut.static_stroke() - 0.02, 0.4), 0.0, durations,
                                             strut.theta, Clock::time);
        REQUIRE(flow.status == FlowStatus::ok);
        CHECK(flow.crossings >= 2);
        double supplied = 0.0, to_oil = 0.0, to_friction = 0.0;
        for (Eigen::Index i = 0; i <= samples; ++i) {
            const double weight = h / 3.0 * (i == 0 || i == samples ? 1.0 : i % 2 == 1 ? 4.0 : 2.0);
            const double v = flow.states(1, i), t = durations[static_cast<std::size_t>(i)];
            supplied -= weight * strut["m"] * strut["amplitude"] * omega * omega * std::cos(omega * t) * v;
            to_oil += weight * (v > 0.0 ? strut["c_compression"] : strut["c_rebound"]) * std::abs(v * v * v);
            to_friction += weight * friction * std::abs(v);
        }
        const double change = strut.energy(flow.states.col(samples)) - strut.energy(flow.states.col(0));
        CHECK(to_oil > 10.0);
        CHECK((friction > 0.0) == (to_friction > 10.0));
        // Joule; measured at most 3.5e-7, times ten: friction times the kink of |v| within a sample.
        CHECK_THAT(change, WithinAbs(supplied - to_oil - to_friction, 3.5e-6));
    }
}

TEST_CASE("dry friction alone takes the same from each half swing of a strut", "[models][reference]") {
    Rig strut;
    strut["amplitude"] = strut["c_compression"] = strut["c_rebound"] = 0.0;
    const double friction = strut["friction"] = 20.0;
    const double middle = strut.static_stroke(), omega = strut.natural_frequency();
    const double decrement = 2.0 * friction / (strut["m"] * omega * omega);  // 2 F / k per half swing
    constexpr Eigen::Index samples = 60000;
    const double end = 4.1 * 2.0 * pi / omega;
    std::vector<double> durations;
    for (Eigen::Index i = 0; i <= samples; ++i)
        durations.push_back(end * static_cast<double>(i) / samples);
    const double amplitude = 2.5e-3;
    const auto flow =
        strut.system->flow(Eigen::Vector2d(middle + amplitude, 0.0), 0.0, durations, strut.theta, Clock::time);
    REQUIRE(flow.status == FlowStatus::ok);
    // Samples next to the turning points.
    std::vector<double> turning{middle + amplitude};
    for (Eigen::Index i = 1; i < samples; ++i)
        if (flow.states(1, i) * flow.states(1, i + 1) < 0.0) turning.push_back(flow.states(0, i));
    REQUIRE(turning.size() == 9);
    for (std::size_t i = 1; i < turning.size(); ++i) {
        CAPTURE(i);
        const double way = std::abs(turning[i] - turning[i - 1]);
        // Exactly: the energy falls by friction times the way. The sample is at most 3e-5 s from the turning point, so
        // it misses 1e-4 J of kinetic energy and 2e-10 m.
        const double loss =
            strut.energy(Eigen::Vector2d(turning[i - 1], 0.0)) - strut.energy(Eigen::Vector2d(turning[i], 0.0));
        CHECK_THAT(loss, WithinAbs(friction * way, 1e-6));
        // The amplitude of a linear spring falls by 2 F / k in each half swing, so the way by twice that. Over a whole
        // swing the asymmetry of the gas spring cancels, up to second order in amplitude / (V0 / area - s) = 0.04.
        if (i >= 3)
            CHECK_THAT(std::abs(turning[i - 2] - turning[i - 3]) - way, WithinRel(4.0 * decrement, 0.04 * 0.04));
    }
}

TEST_CASE("a strut at rest is held by its seals", "[models][fast]") {
    Rig strut;
    strut["amplitude"] = 0.0;
    const double middle = strut.static_stroke();
    const double held = strut["friction"] / (strut["m"] * std::pow(strut.natural_frequency(), 2));
    CHECK(strut.system->at_rest(Eigen::Vector2d(middle + 0.9 * held, 0.0), strut.theta));
    CHECK_FALSE(strut.system->at_rest(Eigen::Vector2d(middle + 1.2 * held, 0.0), strut.theta));
    CHECK_FALSE(strut.system->smooth(strut.theta));
    strut["friction"] = 0.0;
    CHECK(strut.system->smooth(strut.theta));
    // The foot under the strut is at its highest, so accelerated downwards, at phase 0: the stroke grows less.
    strut["amplitude"] = 0.01;
    const double at_top = strut.system->rhs(Eigen::Vector2d(middle, 0.0), std::array{0.0}, strut.theta)(1, 0);
    CHECK_THAT(at_top, WithinAbs(-0.01 * 12.0 * 12.0, 1e-12));
}

TEST_CASE("a strut without room for its gas cannot be simulated", "[models][fast]") {
    Rig strut;
    const auto flow = strut.system->flow(Eigen::Vector2d(0.21, 0.1), 0.0, std::array{1.0}, strut.theta, Clock::time);
    CHECK(flow.status == FlowStatus::not_finite);
}

TEST_CASE("a strut over measured ground moves as over the ground that was measured", "[models][reference]") {
    Rig strut;
    const double omega = strut["omega"], amplitude = strut["amplitude"], end = 2.0;
    const auto measured = make_system("landing_gear_damper", "measured_base");
    REQUIRE(measured->kind() == Kind::autonomous);
    REQUIRE(measured->inputs().size() == 1);
    CHECK(measured->inputs()[0].name == "base_acceleration");
    CHECK_THROWS_AS(
        measured->flow(Eigen::Vector2d(0.1, 0.0), 0.0, std::array{1.0}, measured->default_parameters(), Clock::time),
        std::logic_error);
    for (const double friction : {0.0, 300.0}) {
        strut["friction"] = friction;
        const Eigen::VectorXd theta = strut.theta.head(9);
        const std::vector<Eigen::Index> free{0, 2, 6, 8};
        const Eigen::Vector2d x0(0.12, 0.1);
        const double begin = 0.3;
        const auto exact =
            strut.system->flow_with_sensitivities(x0, omega * begin, std::array{end}, strut.theta, free, Clock::time);
        REQUIRE(exact.status == FlowStatus::ok);
        REQUIRE(exact.crossings > 4);
        // A record longer than the flow: the spline is natural at its ends, where u'' is not 0.
        const auto error = [&](int per_second, InputSignal::Interpolation how) {
            std::vector<double> times, accelerations;
            for (int k = -per_second; k <= 4 * per_second; ++k) {
                times.push_back(static_cast<double>(k) / per_second);
                accelerations.push_back(-amplitude * omega * omega * std::cos(omega * times.back()));
            }
            const auto system =
                measured->with_input(std::make_shared<InputSignal>(times, accelerations, std::size_t{1}, how));
            const auto flow = system->flow_with_sensitivities(x0, begin, std::array{end}, theta, free, Clock::time);
            REQUIRE(flow.status == FlowStatus::ok);
            CHECK(flow.crossings == exact.crossings);
            // Columns in the units of the parameters: kg, Pa, N s^2/m^2, N.
            const Eigen::VectorXd scale =
                (Eigen::VectorXd(6) << 1.0, 1.0, theta[0], theta[2], theta[6], 300.0).finished();
            const double derivatives = ((flow.sensitivities - exact.sensitivities) * scale.asDiagonal()).norm();
            return std::max((flow.states - exact.states).norm(), derivatives);
        };
        for (const int per_second : {100, 200}) {
            CAPTURE(friction, per_second);
            CHECK_THAT(std::log2(error(per_second, InputSignal::Interpolation::linear) /
                                 error(2 * per_second, InputSignal::Interpolation::linear)),
                       WithinAbs(2.0, 0.1));
            CHECK_THAT(std::log2(error(per_second, InputSignal::Interpolation::cubic) /
                                 error(2 * per_second, InputSignal::Interpolation::cubic)),
                       WithinAbs(4.0, 0.2));
        }
        // At a kilohertz the cubic is as good as the harmonic ground: (omega / 1000)^4 / 384 of the acceleration.
        CHECK(error(1000, InputSignal::Interpolation::cubic) < 1e-9);
    }
}

TEST_CASE("a strut over measured ground is held and let go by its seals", "[models][fast]") {
    // At rest at the static stroke until the ground's acceleration exceeds friction / m = 0.3 m/s^2.
    Rig strut;
    const double middle = strut.static_stroke();
    const std::vector<double> times{0.0, 1.0, 2.0}, accelerations{0.0, 0.6, 0.0};
    const auto system = make_system("landing_gear_damper", "measured_base")
                            ->with_input(std::make_shared<InputSignal>(times, accelerations, std::size_t{1},
                                                                       InputSignal::Interpolation::linear));
    const auto flow = system->flow(Eigen::Vector2d(middle, 0.0), 0.0, std::array{0.499999, 0.500001, 1.0, 2.0},
                                   strut.theta.head(9), Clock::time);
    REQUIRE(flow.status == FlowStatus::ok);
    CHECK(flow.states(0, 0) == middle);
    CHECK(flow.states(1, 0) == 0.0);
    CHECK(flow.states(1, 1) > 0.0);
    CHECK(flow.states(0, 2) > middle + 1e-3);
    // Held at first and, after a swing, where the ground's acceleration has fallen.
    CHECK(flow.stickings >= 2);
}

}  // namespace orbid::models::landing_gear_damper_test
