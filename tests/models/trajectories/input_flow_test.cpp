#include <chrono>
#include <cmath>
#include <memory>
#include <stdexcept>

#include "models/arithmetic/dual.hpp"
#include "models/kernels/model_system.hpp"
#include "models/trajectories/surface_trajectory.hpp"
#include "tests/catch.hpp"
#include "tests/models/system/difference_error.hpp"

namespace orbid::models::input_flow_test {
namespace {

using tests::closed_form_error;
using tests::ContainsSubstring;
using tests::difference_error;
using tests::second_difference_error;
using tests::WithinAbs;
constexpr auto linear = InputSignal::Interpolation::linear;
constexpr auto cubic = InputSignal::Interpolation::cubic;

// x' = gain u(t), y' = v(t): integrals of two inputs.
struct Integrals {
    static constexpr std::string_view name = "integrals", summary = "integrals", equations = "x' = gain u, y' = v";
    static constexpr std::array coordinates{real("x", "1"), real("y", "1")};
    static constexpr std::array parameters{Parameter{"gain", "1", any_real, 1.0, "gain"}};
    static constexpr std::array inputs{real("u", "1/s"), real("v", "1/s")};
    template <class T>
    static State<T, 2> rhs(const T&, const State<T, 2>&, const Values<T, 1>& p, const std::array<T, 2>& u) {
        return {p[0] * u[0], u[1]};
    }
};
static_assert(InputModel<Integrals> && !ForcedModel<Integrals>);

// x'' = u(t) - w^2 x - 2 d x'.
struct Driven {
    static constexpr std::string_view name = "driven", summary = "oscillator", equations = "x'' = u - w^2 x - 2 d x'";
    static constexpr std::array coordinates{real("x", "m"), real("v", "m/s")};
    static constexpr std::array parameters{Parameter{"w", "rad/s", positive, 3.0, "frequency"},
                                           Parameter{"d", "1/s", nonnegative, 0.2, "damping"}};
    static constexpr std::array inputs{real("u", "m/s^2")};
    template <class T>
    static State<T, 2> rhs(const T&, const State<T, 2>& x, const Values<T, 2>& p, const std::array<T, 1>& u) {
        return {x[1], u[0] - p[0] * p[0] * x[0] - 2.0 * p[1] * x[1]};
    }
};

// A block on a rough floor: x'' = u(t) - c sgn(x'), as one degree of freedom and with the velocity as a surface.
struct Block {
    static constexpr std::string_view name = "block", summary = "block", equations = "x'' = u - c sgn(x')";
    static constexpr auto coordinates = Driven::coordinates;
    static constexpr std::array parameters{Parameter{"c", "m/s^2", nonnegative, 0.5, "dry friction"}};
    static constexpr auto inputs = Driven::inputs;
    static bool smooth(const Values<double, 1>& p) { return p[0] == 0.0; }
    template <class T>
    static State<T, 2> rhs(const T&, const State<T, 2>& x, const Values<T, 1>& p, const auto& side,
                           const std::array<T, 1>& u) {
        return {x[1], u[0] - side * p[0]};
    }
};
struct BlockOnSurface {
    static constexpr std::string_view name = "block_surface", summary = "block", equations = "x'' = u - c sgn(x')";
    static constexpr auto coordinates = Block::coordinates;
    static constexpr auto parameters = Block::parameters;
    static constexpr auto inputs = Block::inputs;
    static constexpr std::size_t surface_count = 1;
    static bool smooth(const Values<double, 1>& p) { return p[0] == 0.0; }
    template <class T>
    static State<T, 2> rhs(const T& t, const State<T, 2>& x, const Values<T, 1>& p, const std::array<double, 1>& side,
                           const std::array<T, 1>& u) {
        return Block::rhs(t, x, p, side[0], u);
    }
    template <class T>
    static Values<T, 1> surfaces(const T&, const State<T, 2>& x, const Values<T, 1>&) {
        return {x[1]};
    }
};
static_assert(InputModel<Block> && SwitchingModel<Block> && InputModel<BlockOnSurface> && SurfaceModel<BlockOnSurface>);

struct WithoutInput {
    static constexpr std::string_view name = "without_input", summary = "decay", equations = "x' = -x";
    static constexpr std::array coordinates{real("x", "1")};
    static constexpr std::array parameters{Parameter{"k", "1/s", positive, 1.0, "rate"}};
    template <class T>
    static State<T, 1> rhs(const T&, const State<T, 1>& x, const Values<T, 1>& p) {
        return {-p[0] * x[0]};
    }
};

template <class M>
std::shared_ptr<const System> reading(const std::vector<double>& times, const std::vector<double>& values,
                                      InputSignal::Interpolation how) {
    return ModelSystem<M>().with_input(std::make_shared<InputSignal>(times, values, M::inputs.size(), how));
}

const std::vector<double> times{-0.5, 0.25, 1.0, 1.125, 2.0, 3.5};

}  // namespace

TEST_CASE("integrals of measured inputs are exact", "[models][reference]") {
    const std::vector<double> u{1.0, 3.0, -2.0, 4.0, 0.0, 1.0}, v{0.5, 0.5, 2.0, -1.0, -1.0, 3.0};
    std::vector<double> values;
    for (std::size_t k = 0; k < times.size(); ++k)
        values.insert(values.end(), {u[k], v[k]});
    const Eigen::VectorXd theta = Eigen::VectorXd::Constant(1, 2.5);
    for (const auto how : {linear, cubic, InputSignal::Interpolation::held}) {
        const auto system = reading<Integrals>(times, values, how);
        CHECK(system->inputs().size() == 2);
        const InputSignal signal(times, values, 2, how);
        // Two Gauss points integrate a cubic.
        std::vector<double> durations;
        std::array<double, 2> sum{};
        std::vector<std::array<double, 2>> integral;
        for (std::size_t k = 0; k + 1 < times.size(); ++k) {
            const double middle = 0.5 * (times[k] + times[k + 1]), half = 0.5 * (times[k + 1] - times[k]);
            for (const double point : {-1.0 / std::sqrt(3.0), 1.0 / std::sqrt(3.0)}) {
                std::array<double, 2> now;
                signal.evaluate(k, middle + point * half, now.data());
                for (std::size_t i = 0; i < 2; ++i)
                    sum[i] += half * now[i];
            }
            durations.push_back(times[k + 1] - times.front());
            integral.push_back(sum);
        }
        const std::vector<Eigen::Index> free{0};
        const auto flow = system->flow_with_sensitivities(Eigen::Vector2d(1.0, 0.0), times.front(), durations, theta,
                                                          free, Clock::time);
        // The last duration ends with the signal.
        REQUIRE(flow.status == FlowStatus::ok);
        for (Eigen::Index k = 0; k < 5; ++k) {
            const auto& [x, y] = integral[static_cast<std::size_t>(k)];
            CAPTURE(k, name(how));
            CHECK_THAT(flow.states(0, k), WithinAbs(1.0 + 2.5 * x, 5e-14));
            CHECK_THAT(flow.states(1, k), WithinAbs(y, 5e-14));
            CHECK_THAT(flow.sensitivity(k, 3)(0, 2), WithinAbs(x, 5e-14));
        }
    }
}

TEST_CASE("an oscillator driven by straight lines keeps its closed form and derivatives", "[models][reference]") {
    const std::vector<double> values{1.0, 3.0, -2.0, 4.0, 0.0, 1.0};
    const auto system = reading<Driven>(times, values, linear);
    const Eigen::VectorXd theta = system->default_parameters();
    using D = Dual<4>;
    const D w = D::variable(theta[0], 2), d = D::variable(theta[1], 3);
    const D w2 = w * w, wd = sqrt(w2 - d * d);
    const double begin = 0.1;
    D x = D::variable(0.4, 0), v = D::variable(-0.7, 1), at = begin;
    std::vector<double> durations;
    std::vector<std::array<D, 2>> expected;
    for (std::size_t k = 0; k + 1 < times.size(); ++k) {
        // On a piece u = u0 + r s: particular solution u0 / w2 - 2 d r / w2^2 + r s / w2.
        const double r = (values[k + 1] - values[k]) / (times[k + 1] - times[k]);
        const double u0 = values[k] + r * (at.value - times[k]);
        const D level = u0 / w2 - 2.0 * d * r / (w2 * w2), rise = r / w2;
        for (const double part : {0.5, 1.0}) {
            const double s = part * (times[k + 1] - at.value);
            const D x0 = x - level, v0 = v - rise;
            const D c = exp(-d * s) * cos(wd * s), b = exp(-d * s) * sin(wd * s) / wd;
            const std::array<D, 2> now{level + rise * s + c * x0 + b * (v0 + d * x0),
                                       rise + c * v0 - b * (w2 * x0 + d * v0)};
            durations.push_back(at.value + s - begin);
            expected.push_back(now);
            if (part == 1.0) {
                x = now[0];
                v = now[1];
            }
        }
        at = D(times[k + 1]);
    }
    const std::vector<Eigen::Index> free{0, 1};
    const auto flow =
        system->flow_with_sensitivities(Eigen::Vector2d(0.4, -0.7), begin, durations, theta, free, Clock::time);
    REQUIRE(flow.status == FlowStatus::ok);
    for (std::size_t k = 0; k < durations.size(); ++k) {
        CAPTURE(k);
        CHECK(closed_form_error(flow, static_cast<Eigen::Index>(k), expected[k]) < 1e-11);
    }
    CHECK(system->flow(Eigen::Vector2d(0.4, -0.7), begin, durations, theta, Clock::time).states == flow.states);
    // u' jumps and the order is kept: steps of a tenth of a second. Fewer than half of them would do with a method that
    // need not stop ten times on the way.
    CHECK(flow.steps < 60);
    CHECK(system->rhs(Eigen::Vector2d(0.4, -0.7), std::array{0.625}, theta)(1, 0) == 0.5 - 9.0 * 0.4 + 2.0 * 0.2 * 0.7);
}

TEST_CASE("a held force that jumps above the friction lets a block go at once", "[models][reference]") {
    const std::vector<double> instants{0.0, 1.0, 2.0, 3.0}, force{0.0, 1.25, 0.0, 0.0};
    const Eigen::VectorXd theta = Eigen::VectorXd::Constant(1, 0.5);
    const auto how = InputSignal::Interpolation::held;
    for (const auto& system : {reading<Block>(instants, force, how), reading<BlockOnSurface>(instants, force, how)}) {
        CAPTURE(system->name());
        const std::vector<double> durations{0.5, 1.0, 1.5, 2.0, 2.5, 3.0};
        const auto flow = system->flow(Eigen::Vector2d(0.2, 0.0), 0.0, durations, theta, Clock::time);
        REQUIRE(flow.status == FlowStatus::ok);
        // At rest, then x'' = 0.75 for a second, then -0.5.
        const std::array expected{0.2, 0.2, 0.2 + 0.375 * 0.25, 0.575, 0.575 + 0.375 - 0.0625, 0.575 + 0.75 - 0.25};
        for (std::size_t k = 0; k < durations.size(); ++k)
            CHECK_THAT(flow.states(0, static_cast<Eigen::Index>(k)), WithinAbs(expected[k], 1e-12));
    }
}

TEST_CASE("a block is let go where a measured force exceeds the friction", "[models][reference]") {
    // u = t - 1 in pieces: at rest until u = c, then x = (t - t*)^3 / 6 until u falls.
    std::vector<double> rising, force;
    for (int k = 0; k <= 30; ++k) {
        rising.push_back(0.1 * k);
        force.push_back(0.1 * k - 1.0);
    }
    const Eigen::VectorXd theta = Eigen::VectorXd::Constant(1, 0.55);
    const std::vector<Eigen::Index> free{0};
    const std::vector<double> durations{0.5, 1.5, 2.0, 3.0};
    for (const auto how : {linear, cubic})
        for (const auto& system : {reading<Block>(rising, force, how), reading<BlockOnSurface>(rising, force, how)}) {
            CAPTURE(system->name(), how == cubic);
            // From t = 0 u is below -c: it slips backwards first, from rest, until it is caught; take a start at 0.5.
            const auto flow =
                system->flow_with_sensitivities(Eigen::Vector2d(2.0, 0.0), 0.6, durations, theta, free, Clock::time);
            CHECK(flow.status == FlowStatus::no_input);
            CHECK_THAT(flow.stopped_after, WithinAbs(2.4, 1e-15));
            using D = Dual<3>;
            const D c = D::variable(0.55, 2), x0 = D::variable(2.0, 0);
            for (Eigen::Index k = 0; k < 3; ++k) {
                const D s = 0.6 + durations[static_cast<std::size_t>(k)] - (1.0 + c);
                const std::array<D, 2> held{x0, D(0.0)}, moving{x0 + s * s * s / 6.0, 0.5 * s * s};
                CAPTURE(k);
                // Rounding of instants. Measured 1.5e-16.
                CHECK(closed_form_error(flow, k, s.value > 0.0 ? moving : held) < 1e-14);
            }
            CHECK(flow.stickings == 1);
            // Moving at first: caught and let go. From v = 0.4 at t = 0.6, v' = t - 1 - c until v = 0.
            CHECK(difference_error(*system, Eigen::Vector2d(0.0, 0.4), 0.6, 2.0, theta, free, Clock::time) < 1e-9);
            CHECK(second_difference_error(*system, Eigen::Vector2d(0.0, 0.4), 0.6, 2.0, theta, free, Clock::time) <
                  1e-8);
        }
}

TEST_CASE("a measured input does not reach everywhere", "[models][fast]") {
    const std::vector<double> values{1.0, 3.0, -2.0, 4.0, 0.0, 1.0};
    for (const auto& system : {reading<Driven>(times, values, linear), reading<Block>(times, values, linear),
                               reading<BlockOnSurface>(times, values, cubic)}) {
        const Eigen::VectorXd theta = system->default_parameters();
        const auto from = [&](double begin, double duration, std::size_t steps = 1000) {
            const std::array<double, 1> durations{duration};
            return system->flow(Eigen::Vector2d(0.0, 0.1), begin, durations, theta, Clock::time,
                                {.maximum_steps = steps});
        };
        CAPTURE(system->name());
        CHECK(from(-0.5, 4.0).status == FlowStatus::ok);
        CHECK(from(-0.6, 0.5).status == FlowStatus::no_input);
        CHECK(from(-0.6, 0.5).stopped_after == 0.0);
        CHECK(from(3.5, 0.1).status == FlowStatus::no_input);
        CHECK(from(7.0, 0.1).status == FlowStatus::no_input);
        CHECK(from(3.5, 0.0).status == FlowStatus::ok);
        const auto over = from(1.1, 2.5);
        CHECK(over.status == FlowStatus::no_input);
        CHECK_THAT(over.stopped_after, WithinAbs(2.4, 1e-15));
        CHECK(std::isfinite(over.stopped_state.sum()));
        CHECK(from(-0.5, 4.0, 3).status == FlowStatus::step_budget);
        // Instants of which rounding makes something else: 0.1 + 3.4 > 3.5.
        CHECK(from(0.1, 3.4).status == FlowStatus::ok);
        CHECK(from(0.7, 2.8).status == FlowStatus::ok);
    }
}

TEST_CASE("inputs that are refused", "[models][fast]") {
    const auto two = std::make_shared<InputSignal>(std::vector{0.0, 1.0}, std::vector{0.0, 0.0, 1.0, 1.0}, 2, linear);
    const ModelSystem<Driven> driven;
    CHECK_THROWS_AS(driven.with_input(two), std::invalid_argument);
    CHECK_THROWS_WITH(driven.with_input(two), ContainsSubstring("the signal has 2 inputs, must have 1"));
    CHECK_THROWS_AS(driven.with_input(nullptr), std::invalid_argument);
    const ModelSystem<WithoutInput> without;
    CHECK_THROWS_AS(without.with_input(two), std::invalid_argument);
    CHECK_THROWS_WITH(without.with_input(two), ContainsSubstring("has no measured inputs"));
    // Nothing to read.
    const System& system = driven;
    const Eigen::VectorXd theta = system.default_parameters();
    const std::array<double, 1> duration{0.5};
    const Eigen::Vector2d x0(0.0, 0.0);
    CHECK_THROWS_AS(system.flow(x0, 0.0, duration, theta, Clock::time), std::logic_error);
    CHECK_THROWS_AS(system.flow_with_sensitivities(x0, 0.0, duration, theta, {}, Clock::time), std::logic_error);
    CHECK_THROWS_AS(system.rhs(x0, std::array{0.0}, theta), std::logic_error);
    CHECK_FALSE(system.at_rest(x0, theta));
}

TEST_CASE("a minute at a kilohertz takes a step per column", "[models][fast]") {
    std::vector<double> instants, force;
    for (int k = 0; k <= 60000; ++k) {
        instants.push_back(1e-3 * k);
        force.push_back(std::sin(7.0 * instants.back()));
    }
    const auto system = reading<Driven>(instants, force, cubic);
    const Eigen::VectorXd theta = system->default_parameters();
    const std::vector<Eigen::Index> free{0, 1};
    std::vector<double> durations;
    for (int k = 1; k <= 60000; ++k)
        durations.push_back(instants[static_cast<std::size_t>(k)]);
    const auto flow =
        system->flow_with_sensitivities(Eigen::Vector2d(0.0, 0.0), 0.0, durations, theta, free, Clock::time);
    REQUIRE(flow.status == FlowStatus::ok);
    // The first steps are shorter.
    CHECK(flow.steps < 60050);
    // Forced by sin(7 t): steady part plus decaying part. The spline is wrong by (7e-3)^4 / 384.
    const double w2 = 9.0, d = 0.2, o = 7.0;
    const double denominator = (w2 - o * o) * (w2 - o * o) + 4.0 * d * d * o * o;
    const double sine = (w2 - o * o) / denominator, cosine = -2.0 * d * o / denominator;
    const double t = 60.0, wd = std::sqrt(w2 - d * d);
    const double A = -cosine, B = (-sine * o + d * A) / wd;
    const double x = sine * std::sin(o * t) + cosine * std::cos(o * t) +
                     std::exp(-d * t) * (A * std::cos(wd * t) + B * std::sin(wd * t));
    CHECK_THAT(flow.states(0, 59999), WithinAbs(x, 1e-11));
}

}  // namespace orbid::models::input_flow_test
