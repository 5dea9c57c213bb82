#include <cmath>
#include <numbers>

#include "models/arithmetic/dual.hpp"
#include "models/kernels/model_system.hpp"
#include "models/trajectories/surface_trajectory.hpp"
#include "tests/catch.hpp"
#include "tests/models/system/difference_error.hpp"

namespace orbid::models::surface_test {
namespace {

using tests::closed_form_error;
using tests::difference_error;
using tests::second_difference_error;
using tests::WithinAbs;
constexpr double pi = std::numbers::pi;

// x'' = b cos(omega t) - w2 x - c sgn(x'), as in switching_test.cpp: once with the velocity as a general surface, once
// as the model of one degree of freedom that it is.
struct DryTables {
    static constexpr std::array coordinates{real("x", "m"), real("v", "m/s")};
    static constexpr std::array parameters{Parameter{"w2", "1/s^2", positive, 4.0, "squared frequency"},
                                           Parameter{"c", "m/s^2", nonnegative, 0.5, "dry friction"},
                                           Parameter{"b", "m/s^2", any_real, 0.9, "force"},
                                           Parameter{"omega", "rad/s", positive, 1.5, "frequency of the force"}};
    static constexpr std::size_t forcing_frequency = 3;
    static bool smooth(const Values<double, 4>& p) { return p[1] == 0.0; }
    template <class T>
    static State<T, 2> motion(const T& phase, const State<T, 2>& x, const Values<T, 4>& p, const auto& side) {
        using std::cos;
        return {x[1], p[2] * cos(phase) - p[0] * x[0] - side * p[1]};
    }
};
struct DryOscillator : DryTables {
    static constexpr std::string_view name = "dry", summary = "dry", equations = "dry";
    template <class T>
    static State<T, 2> rhs(const T& phase, const State<T, 2>& x, const Values<T, 4>& p, const auto& side) {
        return motion(phase, x, p, side);
    }
};
struct DryOscillatorOnSurface : DryTables {
    static constexpr std::string_view name = "dry_surface", summary = "dry", equations = "dry";
    static constexpr std::size_t surface_count = 1;
    template <class T>
    static State<T, 2> rhs(const T& phase, const State<T, 2>& x, const Values<T, 4>& p,
                           const std::array<double, 1>& side) {
        return motion(phase, x, p, side[0]);
    }
    template <class T>
    static Values<T, 1> surfaces(const T&, const State<T, 2>& x, const Values<T, 4>&) {
        return {x[1]};
    }
};
static_assert(SwitchingModel<DryOscillator> && !SurfaceModel<DryOscillator>);
static_assert(SurfaceModel<DryOscillatorOnSurface> && !SwitchingModel<DryOscillatorOnSurface>);

// Springs of different stiffness on both sides of x = 0, as the pieces of Chua's resistor: a field with a kink.
struct TwoSprings {
    static constexpr std::string_view name = "two_springs", summary = "kink", equations = "x'' = -w^2 x";
    static constexpr auto coordinates = DryTables::coordinates;
    static constexpr std::array parameters{Parameter{"right", "rad/s", positive, 1.0, "frequency for x > 0"},
                                           Parameter{"left", "rad/s", positive, 3.0, "frequency for x < 0"}};
    static constexpr std::size_t surface_count = 1;
    static bool smooth(const Values<double, 2>& p) { return p[0] == p[1]; }
    template <class T>
    static State<T, 2> rhs(const T&, const State<T, 2>& x, const Values<T, 2>& p, const std::array<double, 1>& side) {
        const T& w = side[0] > 0.0 ? p[0] : p[1];
        return {x[1], -w * w * x[0]};
    }
    template <class T>
    static Values<T, 1> surfaces(const T&, const State<T, 2>& x, const Values<T, 2>&) {
        return {x[0]};
    }
};

// A relay that follows a moving mark at a limited rate: x' = -k sgn(x - a sin(omega t)).
struct Relay {
    static constexpr std::string_view name = "relay", summary = "relay", equations = "x' = -k sgn(x - a sin(omega t))";
    static constexpr std::array coordinates{real("x", "m")};
    static constexpr std::array parameters{Parameter{"k", "m/s", positive, 1.0, "rate"},
                                           Parameter{"a", "m", positive, 0.8, "amplitude of the mark"},
                                           Parameter{"omega", "rad/s", positive, 2.0, "frequency of the mark"}};
    static constexpr std::size_t forcing_frequency = 2;
    static constexpr std::size_t surface_count = 1;
    static bool smooth(const Values<double, 3>&) { return false; }
    template <class T>
    static State<T, 1> rhs(const T&, const State<T, 1>&, const Values<T, 3>& p, const std::array<double, 1>& side) {
        return {-side[0] * p[0]};
    }
    template <class T>
    static Values<T, 1> surfaces(const T& phase, const State<T, 1>& x, const Values<T, 3>& p) {
        using std::sin;
        return {x[0] - p[1] * sin(phase)};
    }
};

// A circle of radius R that is approached at constant speed from both sides, with different rotation: the surface is
// curved, and what slides along it turns at a mean of both rates.
struct Circle {
    static constexpr std::string_view name = "circle", summary = "sliding on a circle", equations = "r' = -+ k";
    static constexpr std::array coordinates{real("x", "m"), real("y", "m")};
    static constexpr std::array parameters{Parameter{"R", "m", positive, 1.0, "radius"},
                                           Parameter{"outer", "m/s", positive, 0.7, "speed inwards from outside"},
                                           Parameter{"inner", "m/s", positive, 0.4, "speed outwards from inside"},
                                           Parameter{"outer_turn", "rad/s", any_real, 2.0, "rotation outside"},
                                           Parameter{"inner_turn", "rad/s", any_real, -1.0, "rotation inside"}};
    static constexpr std::size_t surface_count = 1;
    static bool smooth(const Values<double, 5>&) { return false; }
    template <class T>
    static State<T, 2> rhs(const T&, const State<T, 2>& x, const Values<T, 5>& p, const std::array<double, 1>& side) {
        using std::sqrt;
        const T r = sqrt(x[0] * x[0] + x[1] * x[1]);
        const T radial = (side[0] > 0.0 ? -p[1] : p[2]) / r;
        const T turn = side[0] > 0.0 ? p[3] : p[4];
        return {radial * x[0] - turn * x[1], radial * x[1] + turn * x[0]};
    }
    template <class T>
    static Values<T, 1> surfaces(const T&, const State<T, 2>& x, const Values<T, 5>& p) {
        return {x[0] * x[0] + x[1] * x[1] - p[0] * p[0]};
    }
};

template <class M>
const System& system_of() {
    static const ModelSystem<M> system;
    return system;
}

std::vector<Eigen::Index> all_of(const System& system) {
    std::vector<Eigen::Index> free(system.parameters().size());
    for (std::size_t i = 0; i < free.size(); ++i)
        free[i] = static_cast<Eigen::Index>(i);
    return free;
}

}  // namespace

TEST_CASE("friction as a general surface equals friction of one degree of freedom", "[models][reference]") {
    const System &surface = system_of<DryOscillatorOnSurface>(), &switching = system_of<DryOscillator>();
    const std::vector<double> durations{0.0, 0.5, 1.0, 2.0, 3.0, 5.0, 7.0, 20.0, 40.0};
    Eigen::VectorXd weak = surface.default_parameters();
    weak[2] = 0.05;  // held for ever
    std::size_t sticking = 0;
    for (const Clock clock : {Clock::time, Clock::phase})
        for (const Eigen::VectorXd& theta : {surface.default_parameters(), weak})
            for (const Eigen::Vector2d& x0 : {Eigen::Vector2d(0.0, 0.0), Eigen::Vector2d(0.02, 0.3),
                                              Eigen::Vector2d(1.1, 0.0), Eigen::Vector2d(-0.5, 1.0)}) {
                CAPTURE(clock == Clock::phase, theta[2], x0[0], x0[1]);
                const auto a = surface.flow_with_sensitivities(x0, 0.3, durations, theta, all_of(surface), clock);
                const auto b = switching.flow_with_sensitivities(x0, 0.3, durations, theta, all_of(surface), clock);
                REQUIRE(a.status == FlowStatus::ok);
                REQUIRE(b.status == FlowStatus::ok);
                CHECK(a.crossings == b.crossings);
                CHECK(a.stickings == b.stickings);
                sticking += a.stickings;
                CHECK((a.states - b.states).cwiseAbs().maxCoeff() < 1e-12);
                // Derivatives are of size 1 and more. Measured 4.8e-13.
                CHECK((a.sensitivities - b.sensitivities).cwiseAbs().maxCoeff() < 4.8e-12);
                CHECK(surface.flow(x0, 0.3, durations, theta, clock).states == a.states);
            }
    CHECK(sticking >= 8);
    CHECK(surface.at_rest(Eigen::Vector2d(0.1, 0.0), weak));
    CHECK_FALSE(surface.at_rest(Eigen::Vector2d(0.3, 0.0), weak));
    CHECK_FALSE(surface.at_rest(Eigen::Vector2d(0.1, 0.0), surface.default_parameters()));
    const std::array<double, 2> phases{0.3, 0.3};
    Eigen::MatrixXd states(2, 2);
    states << 0.02, 0.5, 0.0, 0.0;
    CHECK(surface.rhs(states, phases, weak) == switching.rhs(states, phases, weak));
}

TEST_CASE("two springs: half an oscillation on each side", "[models][reference]") {
    const System& system = system_of<TwoSprings>();
    const Eigen::VectorXd theta = system.default_parameters();
    const double right = theta[0], left = theta[1];
    // From (0, 1): half a period to (0, -1) on the right, half a period back on the left.
    const double period = pi / right + pi / left;
    const std::array<double, 3> durations{pi / right, 5.0 * period, 5.0 * period + 0.5 * pi / right};
    const Eigen::Vector2d x0(0.0, 1.0);
    using D = Dual<4>;
    const D w = D::variable(right, 2), u = D::variable(left, 3);
    // Energy and phase: x = (r / w) sin(w t), r^2 = v0^2 + w^2 x0^2, begun at w t = w x0 / v0.
    const D start = D::variable(0.0, 0), speed = D::variable(1.0, 1);
    for (const double tolerance : {1e-6, 1e-9, 1e-12}) {
        CAPTURE(tolerance);
        const auto flow =
            system.flow_with_sensitivities(x0, 0.0, durations, theta, all_of(system), Clock::time,
                                           {.relative_tolerance = tolerance, .absolute_tolerance = tolerance});
        REQUIRE(flow.status == FlowStatus::ok);
        CHECK(flow.crossings >= 10);
        for (const Eigen::Index k : {Eigen::Index{1}, Eigen::Index{2}}) {
            const double begun = 5.0 * period;
            const D ahead = durations[static_cast<std::size_t>(k)] - 5.0 * (pi / w + pi / u) + start / speed;
            const std::array<D, 2> expected{speed / w * sin(w * ahead), speed * cos(w * ahead)};
            CAPTURE(k, begun);
            // Ten crossings and some fifty steps; measured at most 4.5 tolerances.
            CHECK(closed_form_error(flow, k, expected) < 45.0 * tolerance);
        }
    }
}

TEST_CASE("a relay slides along a moving mark and is left behind where the mark is faster", "[models][reference]") {
    const System& system = system_of<Relay>();
    const Eigen::VectorXd theta = system.default_parameters();
    const double k0 = 1.0, a0 = 0.8, omega0 = 2.0, phase = 4.0, from = -0.3;
    // The mark is on its way to its lowest point; the relay falls with rate k and meets it just behind. There the mark
    // is slower than the relay, which slides along it until a omega cos = k, at 2 pi - acos(k / (a omega)); then it
    // lags behind with rate k.
    for (const Clock clock : {Clock::time, Clock::phase}) {
        using D = Dual<4>;
        const D x0 = D::variable(from, 0), k = D::variable(k0, 1), a = D::variable(a0, 2),
                omega = D::variable(omega0, 3);
        // x0 - k t = a sin(phase + omega t), by Newton in dual arithmetic.
        D caught = 0.47;
        for (int i = 0; i < 12; ++i)
            caught = caught - (x0 - k * caught - a * sin(phase + omega * caught)) /
                                  (-k - a * omega * cos(phase + omega * caught));
        const D release = (2.0 * pi - acos(k / (a * omega)) - phase) / omega;
        REQUIRE(caught.value > 0.3);
        REQUIRE(caught.value < release.value);
        const std::array<double, 4> times{0.3, 0.5 * (caught.value + release.value), 0.999 * release.value,
                                          release.value + 0.3};
        std::vector<double> durations(times.begin(), times.end());
        if (clock == Clock::phase)
            for (double& duration : durations)
                duration *= omega0;
        const Eigen::VectorXd start = Eigen::VectorXd::Constant(1, from);
        const auto flow = system.flow_with_sensitivities(start, phase, durations, theta, all_of(system), clock);
        REQUIRE(flow.status == FlowStatus::ok);
        for (std::size_t i = 0; i < durations.size(); ++i) {
            const D t = clock == Clock::phase ? durations[i] / omega : D(durations[i]);
            D x;
            if (t.value < caught.value)
                x = x0 - k * t;
            else if (t.value < release.value)
                x = a * sin(phase + omega * t);
            else
                x = a * sin(phase + omega * release) + k * (t - release);
            CAPTURE(clock == Clock::phase, i);
            // The relay moves by constants: rounding. Measured 1.7e-16.
            CHECK(closed_form_error(flow, static_cast<Eigen::Index>(i), std::array<D, 1>{x}) < 1.7e-15);
        }
        CHECK(flow.stickings == 1);
        CHECK(flow.crossings == 1);
        CHECK(second_difference_error(system, start, phase, durations.back(), theta, all_of(system), clock) < 1e-8);
        // Held for whole periods: the state is constant under the relay's own field only, so nothing but the mark
        // limits the steps.
        Eigen::VectorXd fast = theta;
        fast[0] = 5.0;
        const std::array<double, 1> long_time{clock == Clock::phase ? 200.0 * omega0 : 200.0};
        const auto held = system.flow_with_sensitivities(start, phase, long_time, fast, all_of(system), clock);
        REQUIRE(held.status == FlowStatus::ok);
        CHECK(held.stickings == 1);
        const D now = clock == Clock::phase ? long_time[0] / omega : D(long_time[0]);
        // Every step ends on the mark. Measured 3e-48.
        CHECK(closed_form_error(held, 0, std::array<D, 1>{a * sin(phase + omega * now)}) < 1e-15);
    }
}

TEST_CASE("sliding along a circle", "[models][reference]") {
    const System& system = system_of<Circle>();
    const Eigen::VectorXd theta = system.default_parameters();
    using D = Dual<7>;
    const D R = D::variable(1.0, 2), outer = D::variable(0.7, 3), inner = D::variable(0.4, 4),
            outer_turn = D::variable(2.0, 5), inner_turn = D::variable(-1.0, 6);
    const std::vector<double> durations{0.2, 1.0, 30.0};
    for (const double radius : {1.3, 0.8}) {
        const Eigen::Vector2d x0(radius * std::cos(0.3), radius * std::sin(0.3));
        const D x = D::variable(x0[0], 0), y = D::variable(x0[1], 1);
        const bool outside = radius > 1.0;
        const D r0 = sqrt(x * x + y * y), angle0 = atan2(y, x);
        const D speed = outside ? -outer : inner, turn = outside ? outer_turn : inner_turn;
        const D caught = (R - r0) / speed;
        // f_s weighs each side with the speed of the other.
        const D sliding = (outer * inner_turn + inner * outer_turn) / (outer + inner);
        const auto flow = system.flow_with_sensitivities(x0, 0.0, durations, theta, all_of(system), Clock::time);
        REQUIRE(flow.status == FlowStatus::ok);
        CHECK(flow.stickings == 1);
        for (std::size_t i = 0; i < durations.size(); ++i) {
            const bool free = durations[i] < caught.value;
            const D r = free ? r0 + speed * durations[i] : R;
            const D angle = angle0 + (free ? turn * durations[i] : turn * caught + sliding * (durations[i] - caught));
            CAPTURE(radius, i);
            // Tolerance 1e-12 over 0.2, 1 and 30 s. Measured 7.7e-12, relative to derivatives by the rotations of 30.
            CHECK(closed_form_error(flow, static_cast<Eigen::Index>(i),
                                    std::array<D, 2>{r * cos(angle), r * sin(angle)}) < 7.7e-11);
        }
        // On the surface to the last digit.
        CHECK_THAT(flow.states.col(2).norm(), WithinAbs(1.0, 4e-16));
        CHECK(difference_error(system, x0, 0.0, 1.0, theta, all_of(system), Clock::time) < 1e-9);
        CHECK(second_difference_error(system, x0, 0.0, 1.0, theta, all_of(system), Clock::time) < 1e-8);
    }
    // A start on the surface: sliding at once.
    const auto on = system.flow(Eigen::Vector2d(1.0, 0.0), 0.0, durations, theta, Clock::time);
    CHECK(on.stickings == 1);
    const double turn = (0.7 * -1.0 + 0.4 * 2.0) / 1.1;
    CHECK_THAT(std::atan2(on.states(1, 1), on.states(0, 1)), WithinAbs(turn, 1e-13));
}

}  // namespace orbid::models::surface_test
