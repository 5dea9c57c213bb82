#include <cmath>
#include <numbers>

#include "models/catalogue/parametric_pendulum.hpp"
#include "models/catalogue/registry.hpp"
#include "models/kernels/model_system.hpp"
#include "models/trajectories/flow.hpp"
#include "tests/catch.hpp"
#include "tests/models/catalogue/orbit_table.hpp"

namespace orbid::models::flow_test {

using tests::ContainsSubstring;
using tests::WithinAbs;
using tests::WithinRel;

namespace {
constexpr double pi = std::numbers::pi;
using Durations = std::vector<double>;
using Free = std::vector<Eigen::Index>;

/// Pushed by a force with many periods in one of the phase.
struct Pushed {
    static constexpr std::string_view name = "pushed";
    static constexpr std::string_view summary = "a force without a state";
    static constexpr std::string_view equations = "x' = b cos(m omega t)";
    static constexpr std::array coordinates{real("x", "m")};
    static constexpr std::array parameters{Parameter{"b", "m/s", any_real, 1.0, "force"},
                                           Parameter{"m", "1", positive, 1.0, "harmonic"},
                                           Parameter{"omega", "rad/s", positive, 1.0, "frequency"}};
    static constexpr std::size_t forcing_frequency = 2;
    template <class T>
    static State<T, 1> rhs(const T& phase, const State<T, 1>& /*x*/, const Values<T, 3>& p) {
        using std::cos;
        return {p[0] * cos(p[1] * phase)};
    }
};
}  // namespace

TEST_CASE("values are bit-identical with and without derivatives", "[models][fast]") {
    for (const char* name : {"parametric_pendulum", "free_pendulum", "duffing", "lotka_volterra"}) {
        CAPTURE(name);
        const auto system = make_system(name);
        const Clock clock = system->kind() == Kind::forced ? Clock::phase : Clock::time;
        Eigen::VectorXd theta = system->default_parameters();
        if (system->parameter_index("k1") >= 0) theta[system->parameter_index("k1")] = 1e-3;
        const Durations durations{0.0, 0.5, 0.5, 3.0, 40.0};
        const Eigen::Vector2d x0(1.2, 2.0);
        const auto plain = system->flow(x0, 0.3, durations, theta, clock);
        Free free;
        for (Eigen::Index i = 0; i <= static_cast<Eigen::Index>(system->parameters().size()); ++i) {
            CAPTURE(free.size());
            const auto with = system->flow_with_sensitivities(x0, 0.3, durations, theta, free, clock);
            CHECK((with.states.array() == plain.states.array()).all());
            CHECK(with.steps == plain.steps);
            CHECK(with.crossings == plain.crossings);
            REQUIRE(with.sensitivities.cols() == 5 * (2 + i));
            CHECK(with.sensitivity(0, 2 + i).leftCols(2).isIdentity(0.0));
            CHECK(with.sensitivity(0, 2 + i).rightCols(i).isZero(0.0));
            CHECK((with.sensitivity(1, 2 + i).array() == with.sensitivity(2, 2 + i).array()).all());
            free.push_back(i);
        }
        CHECK(plain.states.col(0) == x0);
        CHECK(plain.stopped_after == 40.0);
        CHECK(plain.stopped_state == plain.states.col(4));
    }
}

TEST_CASE("sensitivities do not depend on how the parameters are listed", "[models][fast]") {
    const auto system = make_system("parametric_pendulum");
    const Eigen::VectorXd theta = system->default_parameters();
    const Durations durations{5.0};
    const Eigen::Vector2d x0(1.2, 2.0);
    const auto all =
        system->flow_with_sensitivities(x0, 0.0, durations, theta, Free{0, 1, 2, 3, 4, 5, 6, 7, 8}, Clock::phase);
    const auto some = system->flow_with_sensitivities(x0, 0.0, durations, theta, Free{8, 3}, Clock::phase);
    CHECK((some.sensitivities.col(2).array() == all.sensitivities.col(10).array()).all());
    CHECK((some.sensitivities.col(3).array() == all.sensitivities.col(5).array()).all());
}

TEST_CASE("derivative errors stay below 100 tolerances on the reference orbits", "[models][reference]") {
    const auto system = make_system("parametric_pendulum");
    const auto table = tests::orbit_table("g9.81", *system);
    const Durations period{2.0 * pi};
    Free free{0, 1, 3, 4, 5, 6, 7, 8};
    for (const double tolerance : {1e-8, 1e-10}) {
        double worst = 0.0, worst_value = 0.0;
        for (const auto& cycle : table.cycles)
            for (const Eigen::Vector2d& point : cycle.points) {
                const auto exact = system->flow_with_sensitivities(point, 0.0, period, table.theta, free, Clock::phase,
                                                                   {1e-14, 1e-14});
                const auto flow = system->flow_with_sensitivities(point, 0.0, period, table.theta, free, Clock::phase,
                                                                  {tolerance, tolerance});
                for (Eigen::Index j = 0; j < 10; ++j) {
                    // In units of a relative change of a parameter, and relative to the size of the column.
                    const double unit = j < 2 ? 1.0 : table.theta[free[static_cast<std::size_t>(j - 2)]];
                    const double size = 1.0 + exact.sensitivities.col(j).norm() * unit;
                    const double error = (flow.sensitivities.col(j) - exact.sensitivities.col(j)).norm() * unit;
                    worst = std::max(worst, error / size);
                }
                worst_value = std::max(worst_value, (flow.states - exact.states).norm());
            }
        CAPTURE(tolerance, worst / tolerance, worst_value / tolerance);
        CHECK(worst < 100.0 * tolerance);
        CHECK(worst > 0.0);
    }
}

TEST_CASE("the error follows the tolerance", "[models][fast]") {
    // Turning points included: without locating them the jump in the second derivative of k3 phi'|phi'| would show.
    const auto system = make_system("parametric_pendulum");
    const Eigen::VectorXd theta = system->default_parameters();
    const Durations period{2.0 * pi};
    const Eigen::Vector2d x0(0.5, 3.0);
    const auto exact = system->flow(x0, 0.0, period, theta, Clock::phase, {1e-15, 1e-15});
    double before = 0.0;
    std::size_t steps_before = 0;
    for (const double tolerance : {1e-5, 1e-7, 1e-9, 1e-11}) {
        const auto flow = system->flow(x0, 0.0, period, theta, Clock::phase, {tolerance, tolerance});
        REQUIRE(flow.crossings == exact.crossings);
        REQUIRE(flow.crossings > 0);
        const double error = (flow.states - exact.states).norm();
        CAPTURE(tolerance, error, flow.steps);
        // Local errors add up and are stretched: at most 100 tolerances over one period.
        CHECK(error < 100.0 * tolerance);
        if (before > 0.0) {
            CHECK(error < 0.2 * before);
            // Order 8: a hundredth of the error costs 100^(1/8) = 1.8 times the steps.
            CHECK(static_cast<double>(flow.steps) < 2.2 * static_cast<double>(steps_before));
        }
        before = error;
        steps_before = flow.steps;
    }
}

TEST_CASE("a fixed step of half the size has an error smaller by 2^9", "[models][fast]") {
    struct Pendulum : PendulumOn<Support::crank> {};  // of our own: nobody else uses what is compiled here
    const Values<double, 9> p{0.0858, 0.317, 0.0, 4.85e-4, 1.9e-4, 9.81, 0.131, 9.09, 0.173};
    const Field<Pendulum, 0> field(p, 0.0, Clock::phase);
    const auto end = [&](int steps) {
        Stepper<Pendulum, 0> stepper;
        State<double, 2> x{0.2, 11.0};  // turns over: the velocity keeps its sign
        const double h = 4.0 / steps;
        for (int i = 0; i < steps; ++i) {
            State<double, 2> next, error;
            stepper.step(field, x, field(x, i * h), i * h, h, next, error);
            x = next;
        }
        return x;
    };
    const auto exact = end(100);
    double before = 0.0;
    for (const int steps : {4, 8, 16}) {
        const auto x = end(steps);
        const double error = std::hypot(x[0] - exact[0], x[1] - exact[1]);
        CAPTURE(steps, error);
        if (before > 0.0) CHECK_THAT(std::log2(before / error), WithinAbs(9.0, 0.8));
        before = error;
    }
}

TEST_CASE("the error estimate sees forcing that depends on time alone", "[models][fast]") {
    // x' = b cos(m phase), phase = omega t: x = x0 + b sin(m omega t) / (m omega). An estimate from two formulas that
    // agree for f(t) is 0 here, any step is taken, and the answer is wrong by its own size.
    const ModelSystem<Pushed> system;
    Eigen::VectorXd theta(3);
    theta << 3.0, 50.0, 2.0;
    const Durations durations{0.7, 4.0, 20.0};
    for (const double tolerance : {1e-6, 1e-9, 1e-12}) {
        const FlowOptions options{.relative_tolerance = tolerance, .absolute_tolerance = tolerance};
        const auto flow = system.flow_with_sensitivities(Eigen::VectorXd::Constant(1, 0.25), 0.0, durations, theta,
                                                         Free{0}, Clock::time, options);
        REQUIRE(flow.status == FlowStatus::ok);
        for (Eigen::Index k = 0; k < 3; ++k) {
            CAPTURE(tolerance, k, flow.steps);
            const double swing = std::sin(100.0 * durations[static_cast<std::size_t>(k)]) / 100.0;
            // Errors of single steps change their sign with the force: measured at most 0.2 tolerances.
            CHECK_THAT(flow.states(0, k), WithinAbs(0.25 + 3.0 * swing, 2.0 * tolerance));
            CHECK_THAT(flow.sensitivity(k, 2)(0, 1), WithinAbs(swing, 2.0 * tolerance));
            CHECK(flow.sensitivity(k, 2)(0, 0) == 1.0);
        }
    }
}

TEST_CASE("both clocks tell the same story", "[models][fast]") {
    const auto system = make_system("parametric_pendulum");
    const Eigen::VectorXd theta = system->default_parameters();
    const Eigen::Vector2d x0(1.0, -2.0);
    const double omega = theta[7], phase = 0.7;
    const Free free{1, 7};
    const auto by_phase = system->flow_with_sensitivities(x0, phase, Durations{6.0}, theta, free, Clock::phase);
    const auto by_time = system->flow_with_sensitivities(x0, phase, Durations{6.0 / omega}, theta, free, Clock::time);
    CHECK((by_phase.states - by_time.states).norm() < 1e-10);
    const double scale = by_phase.sensitivities.norm();
    CHECK((by_phase.sensitivities.leftCols(3) - by_time.sensitivities.leftCols(3)).norm() < 1e-10 * scale);
    // x at phase = x at t = phase / omega: ds/d omega at fixed phase = at fixed time - f tau / omega^2.
    const Eigen::Vector2d f = system->rhs(by_phase.states, std::array{phase + 6.0}, theta);
    CHECK((by_phase.sensitivities.col(3) - (by_time.sensitivities.col(3) - f * 6.0 / (omega * omega))).norm() <
          1e-10 * scale);
}

TEST_CASE("what cannot be simulated is a status", "[models][fast]") {
    const auto duffing = make_system("duffing");
    Eigen::VectorXd theta = duffing->default_parameters();
    theta[duffing->parameter_index("beta")] = -1.0;  // the spring pushes outwards: infinity in finite time
    const auto escaped = duffing->flow(Eigen::Vector2d(3.0, 1.0), 0.0, Durations{0.1, 50.0}, theta, Clock::time);
    CHECK(escaped.status == FlowStatus::not_finite);
    CHECK(escaped.stopped_after > 0.1);
    CHECK(escaped.stopped_after < 5.0);
    CHECK(escaped.stopped_state.allFinite());
    const auto pendulum = make_system("parametric_pendulum");
    const auto spent = pendulum->flow(Eigen::Vector2d(1.0, 0.0), 0.0, Durations{1000.0}, pendulum->default_parameters(),
                                      Clock::phase, {.maximum_steps = 100});
    CHECK(spent.status == FlowStatus::step_budget);
    CHECK(spent.steps == 100);
    CHECK(spent.stopped_after < 1000.0);
    // A rod shorter than the crank: the root in (M2) is taken of a negative number.
    theta = pendulum->default_parameters();
    theta[8] = 1.5;
    CHECK(pendulum->flow(Eigen::Vector2d(1.0, 0.0), 0.0, Durations{6.0}, theta, Clock::phase).status ==
          FlowStatus::not_finite);
    for (const FlowStatus status :
         {FlowStatus::ok, FlowStatus::step_budget, FlowStatus::not_finite, FlowStatus::grazing})
        CHECK_FALSE(description(status).empty());
}

TEST_CASE("wrong calls of a flow are refused by name, value and rule", "[models][fast]") {
    const auto system = make_system("parametric_pendulum");
    const Eigen::VectorXd theta = system->default_parameters();
    const Eigen::Vector2d x0(1.0, 0.0);
    const auto with = [&](int i, double value) {
        Eigen::VectorXd changed = theta;
        changed[i] = value;
        return changed;
    };
    const Durations one{1.0};
    const auto flow = [&](const Eigen::VectorXd& p) { return system->flow(x0, 0.0, one, p, Clock::phase); };
    CHECK_THROWS_WITH(flow(with(1, 0.0)), ContainsSubstring("parameter l is 0, must be > 0"));
    CHECK_THROWS_WITH(flow(with(3, -1e-4)), ContainsSubstring("parameter k2 is -0.0001, must be >= 0"));
    CHECK_THROWS_WITH(flow(with(7, std::nan(""))), ContainsSubstring("parameter omega is nan, must be > 0"));
    CHECK_THROWS_WITH(flow(with(5, INFINITY)), ContainsSubstring("parameter g is inf"));
    CHECK_THROWS_AS(flow(theta.head(8)), std::invalid_argument);
    CHECK_THROWS_AS(system->flow(Eigen::Vector3d(1, 2, 3), 0.0, one, theta, Clock::phase), std::invalid_argument);
    CHECK_THROWS_AS(system->flow(Eigen::Vector2d(NAN, 0), 0.0, one, theta, Clock::phase), std::invalid_argument);
    CHECK_THROWS_AS(system->flow(x0, NAN, one, theta, Clock::phase), std::invalid_argument);
    CHECK_THROWS_AS(system->flow(x0, 0.0, Durations{2.0, 1.0}, theta, Clock::phase), std::invalid_argument);
    CHECK_THROWS_AS(system->flow(x0, 0.0, Durations{-1.0}, theta, Clock::phase), std::invalid_argument);
    CHECK_THROWS_AS(system->flow(x0, 0.0, Durations{NAN}, theta, Clock::phase), std::invalid_argument);
    CHECK_THROWS_AS(system->flow(x0, 0.0, one, theta, Clock::phase, {.relative_tolerance = 0.0}),
                    std::invalid_argument);
    CHECK_THROWS_AS(system->flow(x0, 0.0, one, theta, Clock::phase, {.maximum_steps = 0}), std::invalid_argument);
    CHECK_THROWS_AS(system->flow_with_sensitivities(x0, 0.0, one, theta, Free{9}, Clock::phase), std::invalid_argument);
    CHECK_THROWS_WITH(system->flow_with_sensitivities(x0, 0.0, one, theta, Free{3, 3}, Clock::phase),
                      ContainsSubstring("k2 is listed twice"));
    const auto prey = make_system("lotka_volterra");
    CHECK_THROWS_AS(prey->flow(x0, 0.0, one, prey->default_parameters(), Clock::phase), std::invalid_argument);
    CHECK_THROWS_AS(prey->period(prey->default_parameters(), Clock::time), std::logic_error);
    CHECK_THROWS_AS(system->rhs(Eigen::MatrixXd::Zero(2, 3), one, theta), std::invalid_argument);
}

}  // namespace orbid::models::flow_test
