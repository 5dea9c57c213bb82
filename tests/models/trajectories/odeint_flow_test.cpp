#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <optional>
#include <string>
#include <vector>

#include "models/catalogue/registry.hpp"
#include "models/equations/equation_text.hpp"
#include "models/trajectories/odeint/odeint_kernel.hpp"
#include "tests/catch.hpp"

namespace orbid::models::odeint_flow_test {

using tests::ContainsSubstring;

namespace {

constexpr double turn = 2.0 * std::numbers::pi;

/// Those that leave smooth equations smooth, the last one first.
std::vector<Eigen::Index> all_parameters(const System& system, const Eigen::VectorXd& theta) {
    std::vector<Eigen::Index> free;
    for (Eigen::Index i = theta.size() - 1; i >= 0; --i) {
        Eigen::VectorXd moved = theta;
        moved[i] += system.parameters()[static_cast<std::size_t>(i)].typical_size;
        if (system.smooth(moved)) free.push_back(i);
    }
    return free;
}

/// Parameters at which the model is smooth, frictions and impacts that may be 0 taken out; nothing where it never is.
std::optional<Eigen::VectorXd> smooth_parameters(const System& system) {
    Eigen::VectorXd theta = system.default_parameters();
    if (system.smooth(theta)) return theta;
    for (Eigen::Index i = 0; i < theta.size(); ++i)
        if (contains(system.parameters()[static_cast<std::size_t>(i)].domain, 0.0)) theta[i] = 0.0;
    if (system.smooth(theta)) return theta;
    return std::nullopt;
}

/// The strut of a landing gear is shorter than what others swing.
Eigen::VectorXd start_of(const System& system) {
    const double size = system.name() == "landing_gear_damper" ? 0.1 : 1.0;
    Eigen::VectorXd x(system.dimension());
    for (Eigen::Index i = 0; i < x.size(); ++i)
        x[i] = size * (0.4 + 0.3 * std::sin(1.0 + static_cast<double>(i)));
    return x;
}

/// Largest difference of columns, each relative to its own largest entry (at least 1).
double difference(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b) {
    REQUIRE(a.rows() == b.rows());
    REQUIRE(a.cols() == b.cols());
    double worst = 0.0;
    for (Eigen::Index j = 0; j < a.cols(); ++j)
        worst = std::max(worst,
                         (a.col(j) - b.col(j)).cwiseAbs().maxCoeff() / std::max(1.0, b.col(j).cwiseAbs().maxCoeff()));
    return worst;
}

std::shared_ptr<const System> written(const EquationText& text) {
    std::vector<EquationProblem> problems;
    auto system = system_from_text(text, problems);
    REQUIRE(problems.empty());
    return system;
}

/// A mass pushed by a force that depends on time alone: x'' = a cos(8 tau), from rest
/// v = a sin(8 omega t) / (8 omega), x = a (1 - cos(8 omega t)) / (8 omega)^2.
std::shared_ptr<const System> pushed_mass() {
    EquationText text;
    text.name = "pushed_mass";
    text.coordinates = {{"x", "v", "m"}, {"v", "a * cos(8 * tau)", "m/s"}};
    text.parameters = {{"a", "m/s^2", Domain::real, 1.0}, {"omega", "rad/s", Domain::positive, 1.5}};
    text.forcing = EquationText::Forcing{"tau", "omega"};
    return written(text);
}

}  // namespace

TEST_CASE("flows and derivatives of every smooth model are the same by both steppers", "[models][odeint]") {
    std::size_t compared = 0;
    double worst_value = 0.0, worst_derivative = 0.0;
    for (const ModelEntry& entry : registered_models()) {
        std::vector<std::string> variants{entry.variants.begin(), entry.variants.end()};
        if (variants.empty()) variants.emplace_back();
        for (const std::string& variant : variants) {
            const auto system = make_system(entry.name, variant);
            if (!odeint_refusal(*system).empty()) continue;
            const auto theta = smooth_parameters(*system);
            if (!theta) continue;
            INFO(entry.name << " " << variant);
            const auto peer = odeint_system(*system);
            const auto free = all_parameters(*system, *theta);
            const bool forced = system->kind() == Kind::forced;
            const std::vector<Clock> clocks =
                forced ? std::vector{Clock::phase, Clock::time} : std::vector{Clock::time};
            for (const Clock clock : clocks) {
                const double whole = forced ? system->period(*theta, clock) : 1.0;
                const std::array durations{0.0, 0.3 * whole, whole};
                const FlowOptions options{1e-11, 1e-11};
                const auto a =
                    system->flow_with_sensitivities(start_of(*system), 0.7, durations, *theta, free, clock, options);
                const auto b =
                    peer->flow_with_sensitivities(start_of(*system), 0.7, durations, *theta, free, clock, options);
                REQUIRE(a.status == FlowStatus::ok);
                REQUIRE(b.status == FlowStatus::ok);
                // Errors of a step are at most 1e-11 (values) and 1e-10 (derivatives by the start) relative; what
                // the flow makes of them is its largest derivative by the start. Some 100 steps of the fifth order,
                // whose errors hardly cancel, for the sum.
                const Eigen::Index n = system->dimension();
                double growth = 1.0;
                for (Eigen::Index k = 0; k < 3; ++k)
                    growth = std::max(growth, a.sensitivity(k, n + std::ssize(free)).leftCols(n).cwiseAbs().maxCoeff());
                const double value = difference(b.states, a.states),
                             derivative = difference(b.sensitivities, a.sensitivities);
                CHECK(value < 1e-9 * growth);
                CHECK(derivative < 1e-8 * growth * growth);
                worst_value = std::max(worst_value, value / growth);
                worst_derivative = std::max(worst_derivative, derivative / (growth * growth));
                CHECK(b.steps > 2 * a.steps);  // order 5 beside order 9: it has been another stepper
                ++compared;
            }
        }
    }
    CAPTURE(worst_value, worst_derivative);
    CHECK(worst_value < 1e-9);
    CHECK(compared >= 15);
}

TEST_CASE("Odeint's second derivatives are the same too", "[models][odeint]") {
    for (const char* name : {"driven_pendulum", "parametric_pendulum", "lorenz", "lorenz96"}) {
        const auto system =
            make_system(name, "", std::string(name) == "lorenz96" ? std::optional<std::size_t>(5) : std::nullopt);
        const auto theta = smooth_parameters(*system);
        REQUIRE(theta);
        INFO(name);
        const auto free = all_parameters(*system, *theta);
        const bool forced = system->kind() == Kind::forced;
        for (const Clock clock : forced ? std::vector{Clock::phase, Clock::time} : std::vector{Clock::time}) {
            const std::array durations{forced ? 0.4 * system->period(*theta, clock) : 0.3};
            const FlowOptions options{1e-11, 1e-11};
            const auto a =
                system->flow_with_second_derivatives(start_of(*system), 0.7, durations, *theta, free, clock, options);
            const auto b = odeint_system(*system)->flow_with_second_derivatives(start_of(*system), 0.7, durations,
                                                                                *theta, free, clock, options);
            REQUIRE(a.status == FlowStatus::ok);
            REQUIRE(b.status == FlowStatus::ok);
            CHECK(difference(b.states, a.states) < 1e-9);
            CHECK(difference(b.sensitivities, a.sensitivities) < 1e-8);
            CHECK(difference(b.second_derivatives, a.second_derivatives) < 1e-7);
        }
    }
}

TEST_CASE("Odeint's stepper sees a forcing by time alone", "[models][odeint]") {
    const auto system = pushed_mass();
    const auto peer = odeint_system(*system);
    const Eigen::VectorXd theta = system->default_parameters();
    const double a = theta[0], w = 8.0 * theta[1], t = 5.0;
    const std::vector<Eigen::Index> free{0, 1};
    const auto flow = peer->flow_with_sensitivities(Eigen::Vector2d::Zero(), 0.0, std::array{t}, theta, free,
                                                    Clock::time, {1e-10, 1e-10});
    REQUIRE(flow.status == FlowStatus::ok);
    // Fehlberg's pair takes the longest steps it may here, and is wrong in the first digit. 1e-10 per step, some 400
    // steps; the velocity's errors move x for 5 s.
    CHECK(flow.steps > 100);
    CHECK(std::abs(flow.states(0, 0) - a * (1.0 - std::cos(w * t)) / (w * w)) < 2e-8);
    CHECK(std::abs(flow.states(1, 0) - a * std::sin(w * t) / w) < 4e-9);
    // d v / d omega = a (8 t cos(w t) / w - 8 sin(w t) / w^2) at a fixed time; 40 times the error of a velocity.
    const double by_omega = 8.0 * a * (t * std::cos(w * t) / w - std::sin(w * t) / (w * w));
    CHECK(std::abs(flow.sensitivity(0, 4)(1, 3) - by_omega) < 2e-7);
    CHECK(std::abs(flow.sensitivity(0, 4)(1, 2) - std::sin(w * t) / w) < 4e-9);
}

TEST_CASE("errors of Odeint's stepper fall with the fifth power of the step", "[models][odeint]") {
    const auto system = make_system("lorenz");
    const auto peer = odeint_system(*system);
    const Eigen::Vector3d start(-13.763610682134200525, -19.578751942451795539, 27.0);
    const std::array durations{0.7};
    const auto theta = system->default_parameters();
    const auto exact = system->flow(start, 0.0, durations, theta, Clock::time, {1e-14, 1e-14});
    std::vector<double> errors, steps;
    for (const double tolerance : {1e-5, 1e-7, 1e-9, 1e-11}) {
        const auto flow = peer->flow(start, 0.0, durations, theta, Clock::time, {tolerance, tolerance});
        REQUIRE(flow.status == FlowStatus::ok);
        errors.push_back((flow.states - exact.states).norm());
        steps.push_back(static_cast<double>(flow.steps));
    }
    const double order = std::log(errors.front() / errors.back()) / std::log(steps.back() / steps.front());
    CAPTURE(errors, steps);
    CHECK(order > 4.5);
    CHECK(order < 5.7);
}

TEST_CASE("Odeint's values do not depend on what else is asked for", "[models][odeint]") {
    const auto peer = odeint_system(*make_system("driven_pendulum"));
    const auto theta = peer->default_parameters();
    const Eigen::Vector2d start(0.3, 1.0);
    const std::vector<double> many{0.5, 1.0, 2.0, 9.0}, last{9.0};
    const auto plain = peer->flow(start, 0.1, last, theta, Clock::phase);
    const auto full =
        peer->flow_with_sensitivities(start, 0.1, many, theta, all_parameters(*peer, theta), Clock::phase);
    REQUIRE(plain.status == FlowStatus::ok);
    CHECK(plain.states.col(0) == full.states.col(3));
    CHECK(plain.steps == full.steps);
    const auto flows = peer->flows(start, std::array{0.1}, last, theta, std::nullopt, Clock::phase);
    CHECK(flows.front().states == plain.states);
}

TEST_CASE("Odeint's ensembles and sections are those of the library's own stepper", "[models][odeint]") {
    SECTION("whole periods of a forced model") {
        const auto system = make_system("driven_pendulum");
        const auto peer = odeint_system(*system);
        Eigen::MatrixXd starts(2, 2);
        starts << 0.3, -1.0, 0.5, 0.2;
        const auto theta = system->default_parameters();
        const auto a = system->ensemble(starts, 0.4, 3, theta, {1e-11, 1e-11});
        const auto b = peer->ensemble(starts, 0.4, 3, theta, {1e-11, 1e-11});
        for (std::size_t i = 0; i < 2; ++i) {
            REQUIRE(b.status[i] == FlowStatus::ok);
            CHECK(difference(b.sections[i], a.sections[i]) < 1e-7);
        }
    }
    SECTION("crossings of a plane, with derivatives") {
        const auto system = make_system("lorenz");
        const auto peer = odeint_system(*system);
        const Section section{Eigen::Vector3d::UnitZ(), 27.0, -1};
        const Eigen::Vector3d start(2.0, 3.0, 20.0);
        const auto theta = system->default_parameters();
        const auto free = all_parameters(*system, theta);
        const auto a = system->crossings(start, section, 4, 5.0, theta, free, {1e-11, 1e-11});
        const auto b = peer->crossings(start, section, 4, 5.0, theta, free, {1e-11, 1e-11});
        REQUIRE(a.status == FlowStatus::ok);
        REQUIRE(b.status == FlowStatus::ok);
        REQUIRE(b.states.cols() == 4);
        CHECK(difference(b.states, a.states) < 1e-7);
        CHECK((b.times - a.times).cwiseAbs().maxCoeff() < 1e-9);
        CHECK(difference(b.sensitivities, a.sensitivities) < 1e-6);
        CHECK(difference(b.time_sensitivities, a.time_sensitivities) < 1e-6);
        const auto values = peer->crossings(start, section, 4, 5.0, theta, std::nullopt, {1e-11, 1e-11});
        CHECK((values.times - a.times).cwiseAbs().maxCoeff() < 1e-9);
        const auto none = peer->crossings(start, {Eigen::Vector3d::UnitZ(), 1000.0, -1}, 1, 5.0, theta);
        CHECK(none.status == FlowStatus::no_crossing);
        CHECK(none.stopped_after == 5.0);
        CHECK(none.states.cols() == 0);
    }
    SECTION("full turns of an angle") {
        // phi' = w: the plane phi = 1 is crossed after (1 - phi0 + 2 pi k) / w, both ways of the direction.
        EquationText text;
        text.coordinates = {{"phi", "w", "rad", true}};
        text.parameters = {{"w", "rad/s", Domain::real, 2.0}};
        const auto peer = odeint_system(*written(text));
        const auto run = peer->crossings(Eigen::VectorXd::Constant(1, 1.0), {Eigen::VectorXd::Ones(1), 1.0, 1}, 3, 50.0,
                                         peer->default_parameters(), std::vector<Eigen::Index>{0});
        REQUIRE(run.status == FlowStatus::ok);
        for (Eigen::Index k = 0; k < 3; ++k) {
            const double t = turn * static_cast<double>(k + 1) / 2.0;
            CHECK(std::abs(run.times[k] - t) < 1e-12 * t);
            CHECK(std::abs(run.time_sensitivities(1, k) + t / 2.0) < 1e-11 * t);  // d t / d w = -t / w
            CHECK(std::abs(run.sensitivities(0, 2 * k + 1)) < 1e-11 * t);         // the point does not move
        }
    }
}

TEST_CASE("Odeint's stepper says how a flow ended", "[models][odeint]") {
    EquationText text;
    text.coordinates = {{"x", "a * x^2", "1"}};
    text.parameters = {{"a", "1/s", Domain::real, 1.0}};
    const auto blow_up = odeint_system(*written(text));
    const Eigen::VectorXd one = Eigen::VectorXd::Ones(1), theta = blow_up->default_parameters();
    // x = 1 / (1 - t)
    const auto before = blow_up->flow(one, 0.0, std::array{0.5}, theta, Clock::time);
    REQUIRE(before.status == FlowStatus::ok);
    CHECK(std::abs(before.states(0, 0) - 2.0) < 1e-10);
    const auto beyond = blow_up->flow(one, 0.0, std::array{0.5, 2.0}, theta, Clock::time);
    CHECK(beyond.status == FlowStatus::not_finite);
    CHECK(std::abs(beyond.stopped_after - 1.0) < 1e-3);
    CHECK(std::abs(beyond.states(0, 0) - 2.0) < 1e-10);
    const auto short_of = blow_up->flow(one, 0.0, std::array{0.5}, theta, Clock::time, {1e-12, 1e-12, 5});
    CHECK(short_of.status == FlowStatus::step_budget);
    CHECK(short_of.steps == 6);
    CHECK(short_of.stopped_after < 0.5);
}

TEST_CASE("Odeint refuses what it cannot integrate", "[models][odeint]") {
    CHECK_THAT(odeint_refusal(*make_system("henon")), ContainsSubstring("map"));
    CHECK_THROWS_AS(odeint_system(*make_system("henon")), std::invalid_argument);
    for (const ModelEntry& entry : registered_models()) {
        const auto system = make_system(entry.name);
        if (system->stiff()) CHECK_THAT(odeint_refusal(*system), ContainsSubstring("stiff"));
    }
    EquationText text;
    text.coordinates = {{"x", "a * (u - x)", "m"}};
    text.inputs = {{"u", "", "m"}};
    text.parameters = {{"a", "1/s", Domain::real, 1.0}};
    CHECK_THAT(odeint_refusal(*written(text)), ContainsSubstring("measured inputs"));

    const auto pendulum = odeint_system(*make_system("parametric_pendulum"));
    Eigen::VectorXd theta = pendulum->default_parameters();
    theta[pendulum->parameter_index("k1")] = 1e-3;
    REQUIRE_FALSE(pendulum->smooth(theta));
    const Eigen::Vector2d start(0.3, 1.0);
    const auto flow = pendulum->flow(start, 0.0, std::array{1.0}, theta, Clock::phase);
    CHECK(flow.status == FlowStatus::not_smooth);
    CHECK(flow.stopped_after == 0.0);
    CHECK(flow.stopped_state == start);
    // Without dry friction values are smooth; the derivative by it is not.
    theta[pendulum->parameter_index("k1")] = 0.0;
    const std::vector<Eigen::Index> friction{pendulum->parameter_index("k1")};
    CHECK(pendulum->flow_with_sensitivities(start, 0.0, std::array{1.0}, theta, {}, Clock::phase).status ==
          FlowStatus::ok);
    CHECK(pendulum->flow_with_sensitivities(start, 0.0, std::array{1.0}, theta, friction, Clock::phase).status ==
          FlowStatus::not_smooth);
    theta[friction.front()] = 1e-3;
    CHECK(pendulum->ensemble(start, 0.0, 2, theta).status.front() == FlowStatus::not_smooth);
    CHECK_THAT(std::string(description(FlowStatus::not_smooth)), ContainsSubstring("smooth"));
}

}  // namespace orbid::models::odeint_flow_test
