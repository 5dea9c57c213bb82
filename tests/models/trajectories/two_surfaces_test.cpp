#include <cmath>
#include <numbers>

#include "models/kernels/model_system.hpp"
#include "models/trajectories/surface_trajectory.hpp"
#include "tests/catch.hpp"
#include "tests/models/system/difference_error.hpp"

namespace orbid::models::two_surfaces_test {
namespace {

using tests::difference_error;
using tests::second_difference_error;
using tests::WithinAbs;
constexpr double pi = std::numbers::pi;

// Two masses on springs, each with dry friction against the ground, coupled by a spring: two velocity surfaces.
struct TwoMasses {
    static constexpr std::string_view name = "two_masses", summary = "friction", equations = "two dry oscillators";
    static constexpr std::array coordinates{real("x", "m"), real("y", "m"), real("v", "m/s"), real("w", "m/s")};
    static constexpr std::array parameters{Parameter{"x_stiffness", "1/s^2", positive, 4.0, "of x"},
                                           Parameter{"y_stiffness", "1/s^2", positive, 9.0, "of y"},
                                           Parameter{"x_friction", "m/s^2", nonnegative, 0.5, "dry"},
                                           Parameter{"y_friction", "m/s^2", nonnegative, 0.7, "dry"},
                                           Parameter{"coupling", "1/s^2", any_real, 0.0, "spring", typical(1.0)},
                                           Parameter{"force", "m/s^2", any_real, 0.9, "on both"},
                                           Parameter{"omega", "rad/s", positive, 1.5, "frequency of the force"}};
    static constexpr std::size_t forcing_frequency = 6;
    static constexpr std::size_t surface_count = 2;
    static bool smooth(const Values<double, 7>& p) { return p[2] == 0.0 && p[3] == 0.0; }
    template <class T>
    static State<T, 4> rhs(const T& phase, const State<T, 4>& x, const Values<T, 7>& p,
                           const std::array<double, 2>& side) {
        using std::cos;
        const T force = p[5] * cos(phase), spring = p[4] * (x[1] - x[0]);
        return {x[2], x[3], force - p[0] * x[0] - side[0] * p[2] + spring,
                force - p[1] * x[1] - side[1] * p[3] - spring};
    }
    template <class T>
    static Values<T, 2> surfaces(const T&, const State<T, 4>& x, const Values<T, 7>&) {
        return {x[2], x[3]};
    }
};
// One of them alone.
struct OneMass {
    static constexpr std::string_view name = "one_mass", summary = "friction", equations = "dry oscillator";
    static constexpr std::array coordinates{real("x", "m"), real("v", "m/s")};
    static constexpr std::array parameters{Parameter{"stiffness", "1/s^2", positive, 4.0, "of x"},
                                           Parameter{"friction", "m/s^2", nonnegative, 0.5, "dry"},
                                           Parameter{"force", "m/s^2", any_real, 0.9, "amplitude"},
                                           Parameter{"omega", "rad/s", positive, 1.5, "frequency of the force"}};
    static constexpr std::size_t forcing_frequency = 3;
    static bool smooth(const Values<double, 4>& p) { return p[1] == 0.0; }
    template <class T>
    static State<T, 2> rhs(const T& phase, const State<T, 2>& x, const Values<T, 4>& p, const auto& side) {
        using std::cos;
        return {x[1], p[2] * cos(phase) - p[0] * x[0] - side * p[1]};
    }
};
// A mass on a rough board that is on rough ground itself: friction at the velocity of one and at the difference of
// both.
struct OnBoard : TwoMasses {
    static constexpr std::string_view name = "on_board", summary = "friction", equations = "mass on a board";
    template <class T>
    static State<T, 4> rhs(const T& phase, const State<T, 4>& x, const Values<T, 7>& p,
                           const std::array<double, 2>& side) {
        using std::cos;
        const T between = side[1] * p[3];
        return {x[2], x[3], p[5] * cos(phase) - p[0] * x[0] - side[0] * p[2] + between, -p[1] * x[1] - between};
    }
    template <class T>
    static Values<T, 2> surfaces(const T&, const State<T, 4>& x, const Values<T, 7>&) {
        return {x[2], x[3] - x[2]};
    }
};
static_assert(SurfaceModel<TwoMasses> && SurfaceModel<OnBoard> && SwitchingModel<OneMass>);

template <class M>
const System& system_of() {
    static const ModelSystem<M> system;
    return system;
}
Eigen::VectorXd theta_of(double coupling) {
    Eigen::VectorXd theta = system_of<TwoMasses>().default_parameters();
    theta[4] = coupling;
    return theta;
}
const std::vector<Eigen::Index> all{0, 1, 2, 3, 4, 5, 6};

}  // namespace

TEST_CASE("two masses without coupling move as two systems", "[models][reference]") {
    const System &both = system_of<TwoMasses>(), &one = system_of<OneMass>();
    const Eigen::VectorXd theta = theta_of(0.0);
    Eigen::VectorXd first(4), second(4);
    first << theta[0], theta[2], theta[5], theta[6];
    second << theta[1], theta[3], theta[5], theta[6];
    const std::vector<double> durations{0.5, 1.0, 2.0, 3.0, 4.0, 5.0};
    const std::vector<Eigen::Index> every{0, 1, 2, 3};
    std::size_t slid = 0;
    for (const Eigen::Vector4d& x0 : {Eigen::Vector4d(0.0, 0.6, 0.0, 0.8), Eigen::Vector4d(0.9, -0.4, 0.0, 0.4),
                                      Eigen::Vector4d(-0.5, 0.5, 1.0, -2.0)})
        for (const Clock clock : {Clock::time, Clock::phase}) {
            const double phase = 1.0;
            const auto flow = both.flow_with_sensitivities(x0, phase, durations, theta, all, clock);
            const auto x =
                one.flow_with_sensitivities(Eigen::Vector2d(x0[0], x0[2]), phase, durations, first, every, clock);
            const auto y =
                one.flow_with_sensitivities(Eigen::Vector2d(x0[1], x0[3]), phase, durations, second, every, clock);
            CAPTURE(x0.transpose(), clock == Clock::phase, flow.stopped_after);
            REQUIRE(flow.status == FlowStatus::ok);
            CHECK(flow.crossings == x.crossings + y.crossings);
            CHECK(flow.stickings == x.stickings + y.stickings);
            slid += flow.stickings;
            for (Eigen::Index k = 0; k < 6; ++k) {
                const Eigen::Vector4d expected(x.states(0, k), y.states(0, k), x.states(1, k), y.states(1, k));
                // Step control at 1e-12, here and there. Measured 1.2e-12.
                CHECK((flow.states.col(k) - expected).cwiseAbs().maxCoeff() < 1.2e-11);
                // Directions: start, stiffness, friction, force, omega.
                const auto d = flow.sensitivity(k, 11);
                const auto dx = x.sensitivity(k, 6), dy = y.sensitivity(k, 6);
                const std::array<Eigen::Index, 6> of_x{0, 2, 4, 6, 9, 10}, of_y{1, 3, 5, 7, 9, 10};
                double worst = 0.0;
                for (Eigen::Index i = 0; i < 2; ++i)
                    for (std::size_t j = 0; j < 6; ++j) {
                        const auto column = static_cast<Eigen::Index>(j);
                        worst = std::max(worst, std::abs(d(2 * i, of_x[j]) - dx(i, column)));
                        worst = std::max(worst, std::abs(d(2 * i + 1, of_y[j]) - dy(i, column)));
                    }
                CHECK(worst < 1e-10);
                // Nothing of one depends on the other.
                CHECK(std::abs(d(0, 1)) + std::abs(d(2, 3)) + std::abs(d(1, 0)) + std::abs(d(3, 4)) < 1e-12);
            }
        }
    CHECK(slid >= 4);
}

TEST_CASE("coupled masses with friction: derivatives across crossings while sliding", "[models][fast]") {
    const System &masses = system_of<TwoMasses>(), &board = system_of<OnBoard>();
    std::size_t slid = 0, crossed = 0;
    for (const System* system : {&masses, &board})
        for (const Eigen::Vector4d& x0 : {Eigen::Vector4d(0.02, 0.6, 0.1, 0.8), Eigen::Vector4d(0.3, -0.5, -0.2, 1.1)})
            for (const Clock clock : {Clock::time, Clock::phase}) {
                const Eigen::VectorXd theta = theta_of(0.8);
                const std::array<double, 1> duration{4.0};
                const auto flow = system->flow(x0, 1.0, duration, theta, clock);
                CAPTURE(system->name(), x0.transpose(), clock == Clock::phase, flow.stopped_after);
                REQUIRE(flow.status == FlowStatus::ok);
                slid += flow.stickings;
                crossed += flow.crossings;
                CHECK(difference_error(*system, x0, 1.0, 4.0, theta, all, clock) < 1e-9);
                // Costly: one start of each is enough.
                if (x0[0] < 0.1 && clock == Clock::time)
                    CHECK(second_difference_error(*system, x0, 1.0, 4.0, theta, {2, 4, 5, 6}, clock) < 1e-9);
            }
    CHECK(slid >= 4);
    CHECK(crossed > 2 * slid);
}

TEST_CASE("two surfaces that hold at once are named", "[models][fast]") {
    const System &both = system_of<TwoMasses>(), &one = system_of<OneMass>();
    // Without force both come to rest: when the second does, both hold.
    Eigen::VectorXd theta = theta_of(0.0);
    theta[5] = 0.0;
    const std::array<double, 1> duration{50.0};
    const Eigen::Vector4d x0(1.1, 0.9, 0.0, 0.3);
    const auto flow = both.flow(x0, 0.0, duration, theta, Clock::time);
    CHECK(flow.status == FlowStatus::held_twice);
    CHECK(description(flow.status).size() > 0);
    Eigen::VectorXd first(4), second(4);
    first << theta[0], theta[2], 0.0, 1.0;
    second << theta[1], theta[3], 0.0, 1.0;
    CHECK_THAT(flow.stopped_state[0],
               WithinAbs(one.flow(Eigen::Vector2d(1.1, 0.0), 0.0, duration, first, Clock::time).states(0, 0), 1e-11));
    CHECK_THAT(flow.stopped_state[1],
               WithinAbs(one.flow(Eigen::Vector2d(0.9, 0.3), 0.0, duration, second, Clock::time).states(0, 0), 1e-11));
    CHECK_THAT(flow.stopped_state.tail(2).norm(), WithinAbs(0.0, 1e-13));
    // Equal masses stop at the same instant.
    theta[1] = theta[0];
    theta[3] = theta[2];
    const auto equal = both.flow(Eigen::Vector4d(1.1, 1.1, 0.0, 0.0), 0.0, duration, theta, Clock::time);
    CHECK(equal.status == FlowStatus::held_twice);
    CHECK_THAT(equal.stopped_after, WithinAbs(2.0 * pi, 1e-12));
    CHECK(equal.crossings == 8);
    // Turning points of both at the same instants are crossings like others.
    const std::array<double, 1> before{6.0};
    const auto moving = both.flow(Eigen::Vector4d(1.1, 1.1, 0.0, 0.0), 0.0, before, theta, Clock::time);
    CHECK(moving.status == FlowStatus::ok);
    CHECK(moving.crossings == 6);
    CHECK_THAT(moving.states(0, 0) - moving.states(1, 0), WithinAbs(0.0, 1e-14));
    // A start that is held by both.
    CHECK(both.flow(Eigen::Vector4d(0.0, 0.0, 0.0, 0.0), 0.0, duration, theta, Clock::time).status ==
          FlowStatus::held_twice);
}

TEST_CASE("short visits behind a surface are found", "[models][reference]") {
    // As for one degree of freedom (switching_test.cpp): w = 2, omega = force = 1, about phase 3 pi / 2
    // v(s) = cos(s) / 3 - (1 / 3 + depth) cos(2 s) while v > 0; near s = 0, v = -depth + s^2 / 2.
    const System& system = system_of<TwoMasses>();
    Eigen::VectorXd theta = theta_of(0.0);
    const double c = 1e-3;
    theta[2] = c;
    theta[3] = 0.0;
    theta[5] = 1.0;
    theta[6] = 1.0;
    const std::array<double, 1> duration{2.0};
    for (const double tolerance : {1e-4, 1e-8, 1e-12})
        for (double depth = 1e-1; depth > 1e-11 && depth > 9.0 * tolerance; depth *= 0.1) {
            const auto about = [&](double deep) {
                const Eigen::Vector4d start(-c / 4.0 - std::sin(1.0) / 3.0 + 0.5 * (1.0 / 3.0 + deep) * std::sin(2.0),
                                            0.0, std::cos(1.0) / 3.0 - (1.0 / 3.0 + deep) * std::cos(2.0), 1.0);
                return system.flow(start, 1.5 * pi - 1.0, duration, theta, Clock::time,
                                   {.relative_tolerance = tolerance, .absolute_tolerance = tolerance});
            };
            const auto dips = about(depth), misses = about(-depth);
            CAPTURE(tolerance, depth);
            CHECK(dips.status == FlowStatus::ok);
            CHECK(misses.status == FlowStatus::ok);
            // The other mass meets its surface as well, twice in both.
            CHECK(dips.crossings + dips.stickings >= 2 + misses.crossings);
            CHECK(misses.stickings == 0);
        }
}

}  // namespace orbid::models::two_surfaces_test
