#include "models/system/derivative_check.hpp"

#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

#include "models/catalogue/registry.hpp"
#include "models/kernels/model_system.hpp"
#include "tests/catch.hpp"

namespace orbid::models::derivative_check_test {

using tests::ContainsSubstring;
using tests::WithinAbs;
using tests::WithinRel;

namespace {

constexpr double turn = 2.0 * std::numbers::pi;

std::vector<Eigen::Index> all_parameters(const System& system) {
    std::vector<Eigen::Index> free;
    for (std::size_t i = 0; i < system.parameters().size(); ++i)
        free.push_back(static_cast<Eigen::Index>(i));
    return free;
}

/// Swinging mass whose author took the damping for a number: c has no part in the derivatives of the velocity.
struct LostDerivative {
    static constexpr std::string_view name = "lost_derivative";
    static constexpr std::string_view summary = "";
    static constexpr std::string_view equations = "x'' = -w2 x - c x'";
    static constexpr std::array coordinates{real("x", "m"), real("x_dot", "m/s")};
    static constexpr std::array parameters{Parameter{"w2", "1/s^2", positive, 4.0, "stiffness"},
                                           Parameter{"c", "1/s", nonnegative, 0.5, "damping"}};
    template <class T>
    static State<T, 2> rhs(const T& /*t*/, const State<T, 2>& x, const Values<T, 2>& p) {
        return {x[1], -p[0] * x[0] - value_of(p[1]) * x[1]};
    }
};

/// Stiffness looked up at the value of the position: right itself, without its slope.
struct SteppedTable {
    static constexpr std::string_view name = "stepped_table";
    static constexpr std::string_view summary = "";
    static constexpr std::string_view equations = "x'' = -w2 x (1 + x^2)";
    static constexpr std::array coordinates{real("x", "m"), real("x_dot", "m/s")};
    static constexpr std::array parameters{Parameter{"w2", "1/s^2", positive, 4.0, "stiffness"}};
    static constexpr bool packs = false;
    template <class T>
    static State<T, 2> rhs(const T& /*t*/, const State<T, 2>& x, const Values<T, 1>& p) {
        const double looked_up = 1.0 + value_of(x[0]) * value_of(x[0]);
        return {x[1], -p[0] * x[0] * looked_up};
    }
};

/// A ten-thousandth of the derivative is lost.
struct SlightlyWrong {
    static constexpr std::string_view name = "slightly_wrong";
    static constexpr std::string_view summary = "";
    static constexpr std::string_view equations = "x' = -k x";
    static constexpr std::array coordinates{real("x", "m")};
    static constexpr std::array parameters{Parameter{"k", "1/s", positive, 0.5, "decay"}};
    template <class T>
    static State<T, 1> rhs(const T& /*t*/, const State<T, 1>& x, const Values<T, 1>& p) {
        return {-(0.9999 * p[0] + 0.0001 * value_of(p[0])) * x[0]};
    }
};

/// Ball that bounces on a floor; right, or with a coefficient of restitution that is taken for a number.
template <bool right>
struct Ball {
    static constexpr std::string_view name = right ? "ball" : "ball_without_restitution";
    static constexpr std::string_view summary = "";
    static constexpr std::string_view equations = "x'' = -g, v+ = -e v- at x = 0";
    static constexpr std::array coordinates{real("x", "m"), real("v", "m/s")};
    static constexpr std::array parameters{Parameter{"g", "m/s^2", positive, 9.81, "gravity"},
                                           Parameter{"e", "1", nonnegative, 0.8, "restitution"}};
    static constexpr std::size_t surface_count = 1;
    static constexpr std::array<bool, 1> impacts{true};
    static bool smooth(const Values<double, 2>&) { return false; }
    template <class T>
    static State<T, 2> rhs(const T&, const State<T, 2>& x, const Values<T, 2>& p, const std::array<double, 1>&) {
        return {x[1], -p[0]};
    }
    template <class T>
    static Values<T, 1> surfaces(const T&, const State<T, 2>& x, const Values<T, 2>&) {
        return {x[0]};
    }
    template <class T>
    static State<T, 2> reset(std::size_t, const T&, const State<T, 2>& x, const Values<T, 2>& p) {
        if constexpr (right)
            return {x[0], -p[1] * x[1]};
        else
            return {x[0], -value_of(p[1]) * x[1]};
    }
};

/// |x| in the equations, without a surface: a kink at 0.
struct Kink {
    static constexpr std::string_view name = "kink";
    static constexpr std::string_view summary = "";
    static constexpr std::string_view equations = "x' = -k |x|";
    static constexpr std::array coordinates{real("x", "m")};
    static constexpr std::array parameters{Parameter{"k", "1/s", positive, 0.5, "decay"}};
    template <class T>
    static State<T, 1> rhs(const T& /*t*/, const State<T, 1>& x, const Values<T, 1>& p) {
        using std::abs;
        return {-p[0] * abs(x[0])};
    }
};

/// x = 1 / (1 / x0 - k t): ends at a finite time.
struct Exploding {
    static constexpr std::string_view name = "exploding";
    static constexpr std::string_view summary = "";
    static constexpr std::string_view equations = "x' = x^2";
    static constexpr std::array coordinates{real("x", "m")};
    static constexpr std::array parameters{Parameter{"k", "1/s", positive, 1.0, "rate"}};
    template <class T>
    static State<T, 1> rhs(const T& /*t*/, const State<T, 1>& x, const Values<T, 1>& p) {
        return {p[0] * x[0] * x[0]};
    }
};

/// A root of 0 in the equations: its value adds nothing, its derivative is no number.
struct NotFinite {
    static constexpr std::string_view name = "not_finite";
    static constexpr std::string_view summary = "";
    static constexpr std::string_view equations = "x' = -k x + sqrt(x - x)";
    static constexpr std::array coordinates{real("x", "m")};
    static constexpr std::array parameters{Parameter{"k", "1/s", positive, 0.5, "decay"}};
    static constexpr bool packs = false;
    template <class T>
    static State<T, 1> rhs(const T& /*t*/, const State<T, 1>& x, const Values<T, 1>& p) {
        using std::sqrt;
        return {-p[0] * x[0] + sqrt(x[0] - x[0])};
    }
};

template <class M>
DerivativeCheck check_of(const Eigen::VectorXd& x0, const std::vector<double>& durations,
                         const DerivativeCheckOptions& options = {}) {
    const ModelSystem<M> system;
    return check_derivatives(system, x0, 0.0, durations, system.default_parameters(), all_parameters(system),
                             Clock::time, options);
}

}  // namespace

TEST_CASE("every registered model passes the check of its derivatives", "[models][fast]") {
    for (const ModelEntry& entry : registered_models()) {
        std::vector<std::string_view> variants = entry.variants;
        if (variants.empty()) variants.emplace_back();
        for (const std::string_view variant : variants) {
            const auto system = make_system(entry.name, variant);
            const Eigen::Index n = system->dimension();
            if (!system->inputs().empty()) continue;
            const bool forced = system->kind() == Kind::forced;
            const std::vector<double> durations = system->kind() == Kind::map
                                                      ? std::vector<double>{1.0, 3.0}
                                                      : std::vector<double>{forced ? 1.0 : 0.3, forced ? turn : 1.5};
            // Starts of both signs, of unequal coordinates; inside (0, 1), where all maps live.
            for (const double scale : {0.31, -0.17, 1.2}) {
                if (system->kind() == Kind::map && scale > 1.0) continue;
                // The strut is 0.2 m long.
                const double unit = entry.name == "landing_gear_damper" ? 0.1 : 1.0;
                Eigen::VectorXd x0(n);
                for (Eigen::Index i = 0; i < n; ++i)
                    x0[i] = unit * scale * (1.0 + 0.4 * std::sin(3.0 * static_cast<double>(i)));
                const auto check = check_derivatives(*system, x0, 0.4, durations, system->default_parameters(),
                                                     all_parameters(*system), forced ? Clock::phase : Clock::time);
                CAPTURE(entry.name, variant, scale, check.message);
                CHECK(check.passed);
                CHECK(check.compared > check.inconclusive);
            }
        }
    }
}

TEST_CASE("friction, sticking and chaos do not look like wrong derivatives", "[models][fast]") {
    const auto system = make_system("parametric_pendulum");
    const auto free = all_parameters(*system);
    Eigen::VectorXd theta = system->default_parameters();
    std::size_t compared = 0, inconclusive = 0;
    int index = 0;
    for (const double k1 : {0.0, 1e-3, 0.05, 0.1})
        for (const Clock clock : {Clock::phase, Clock::time})
            for (int i = 0; i < 8; ++i) {
                theta[2] = k1;
                ++index;
                // Spread over the plane by two irrational steps.
                const Eigen::Vector2d x0(turn * (std::fmod(index * 0.7548776662466927, 1.0) - 0.5),
                                         24.0 * (std::fmod(index * 0.5698402909980532, 1.0) - 0.5));
                const double period = clock == Clock::phase ? turn : turn / theta[7];
                const std::vector<double> durations{0.3 * period, 2.0 * period};
                const auto check = check_derivatives(*system, x0, 0.1 * i, durations, theta, free, clock);
                CAPTURE(k1, clock == Clock::phase, x0[0], x0[1], check.message);
                CHECK(check.passed);
                compared += check.compared;
                inconclusive += check.inconclusive;
            }
    CHECK(inconclusive < compared / 20);
    // On the switching surface the derivative by the velocity is one-sided. Held for ever, and close to letting go.
    theta[2] = 1e-3;
    for (const double phi : {-2.0, -0.5, 0.0, 0.0019, 0.0020, 0.003, 0.02, 1.2}) {
        const auto check = check_derivatives(*system, Eigen::Vector2d(phi, 0.0), 0.3, std::array{0.5, turn}, theta,
                                             free, Clock::phase);
        CAPTURE(phi, check.message);
        CHECK(check.passed);
        CHECK(check.compared > 0);
    }
    // Chaos: over nine periods a disturbance grows a thousand times and folds, at two tolerances; over thirty, by 1e10.
    compared = inconclusive = 0;
    for (const double tolerance : {1e-12, 1e-9})
        for (int i = 0; i < 6; ++i) {
            const Eigen::Vector2d x0(0.3 + 0.4 * i, 1.0 - i);
            const DerivativeCheckOptions options{
                .flow = {.relative_tolerance = tolerance, .absolute_tolerance = tolerance}};
            const auto check =
                check_derivatives(*system, x0, 0.0, std::array{9.0 * turn}, theta, free, Clock::phase, options);
            CAPTURE(x0[0], x0[1], check.message);
            CHECK(check.passed);
            compared += check.compared;
            inconclusive += check.inconclusive;
        }
    CHECK(compared > 0);
    CHECK(inconclusive > 0);
    const auto lost =
        check_derivatives(*system, Eigen::Vector2d(2.0, 1.0), 0.0, std::array{30.0 * turn}, theta, free, Clock::phase);
    CAPTURE(lost.message);
    CHECK(lost.passed);
}

TEST_CASE("the check of derivatives names what is wrong", "[models][fast]") {
    const auto lost = check_of<LostDerivative>(Eigen::Vector2d(1.0, 0.3), {0.25, 0.7});
    CHECK_FALSE(lost.passed);
    CHECK(lost.direction == 3);
    CHECK(lost.derivative == 0.0);
    CHECK_THAT(lost.relative_error, WithinAbs(1.0, 0.0));
    CHECK_THAT(lost.message, ContainsSubstring("model lost_derivative: d x_dot / d c after 0."));
    CHECK_THAT(lost.message, ContainsSubstring("is 0 by derivatives, "));

    const auto stepped = check_of<SteppedTable>(Eigen::Vector2d(1.0, 0.3), {0.7});
    CHECK_FALSE(stepped.passed);
    CHECK_THAT(stepped.message, ContainsSubstring("of the start after 0.7 s is "));

    // d x / d k = -t x: by derivatives one part in 1e4 less.
    const auto slightly = check_of<SlightlyWrong>(Eigen::VectorXd::Constant(1, 2.0), {1.5});
    CHECK_FALSE(slightly.passed);
    CHECK(slightly.coordinate == 0);
    CHECK(slightly.direction == 1);
    CHECK(slightly.duration == 1.5);
    CHECK(slightly.compared == 2);
    CHECK_THAT(slightly.difference, WithinRel(-1.5 * 2.0 * std::exp(-0.75), 1e-7));
    CHECK_THAT(slightly.relative_error, WithinRel(1e-4, 1e-2));
    // As much may be allowed.
    CHECK(check_of<SlightlyWrong>(Eigen::VectorXd::Constant(1, 2.0), {1.5}, {.relative_tolerance = 2e-4, .flow = {}})
              .passed);

    // Derivatives without a value, of a flow that has one.
    const auto none = check_of<NotFinite>(Eigen::VectorXd::Constant(1, 2.0), {1.5});
    CAPTURE(none.message);
    CHECK_FALSE(none.passed);

    // Wrong after the first of two impacts only.
    const auto ball = check_of<Ball<false>>(Eigen::Vector2d(1.0, 0.3), {0.2, 0.6, 1.4});
    CHECK_FALSE(ball.passed);
    CHECK(ball.direction == 3);
    CHECK(ball.duration > 0.2);
    CHECK_THAT(ball.message, ContainsSubstring(" / d e after "));
    CHECK(check_of<Ball<false>>(Eigen::Vector2d(1.0, 0.3), {0.2}).passed);
    const auto right = check_of<Ball<true>>(Eigen::Vector2d(1.0, 0.3), {0.2, 0.6, 1.4});
    CAPTURE(right.message);
    CHECK(right.passed);
    CHECK(right.inconclusive == 0);
}

TEST_CASE("what cannot be compared is not called wrong", "[models][fast]") {
    // At the kink the derivative is one of the two sides.
    CHECK(check_of<Kink>(Eigen::VectorXd::Zero(1), {1.0}).passed);
    CHECK(check_of<Kink>(Eigen::VectorXd::Constant(1, 1e-3), {1.0}).passed);
    // x = 1 / (1 - t) ends at t = 1: with derivatives before, nothing to compare after.
    const auto before = check_of<Exploding>(Eigen::VectorXd::Constant(1, 1.0), {0.5});
    CHECK(before.passed);
    CHECK(before.compared == 2);
    CHECK(before.inconclusive == 0);
    const auto after = check_of<Exploding>(Eigen::VectorXd::Constant(1, 1.0), {0.5, 1.5});
    CHECK(after.passed);
    CHECK(after.compared == 0);
    CHECK(after.inconclusive == 4);
    CHECK_THAT(after.message, ContainsSubstring("model exploding: no derivative could be compared"));
    const auto nothing = check_of<Exploding>(Eigen::VectorXd::Constant(1, 1.0), {});
    CHECK(nothing.passed);
    CHECK(nothing.compared == 0);
}

TEST_CASE("the check of derivatives refuses a tolerance that is not positive", "[models][fast]") {
    const Eigen::VectorXd x0 = Eigen::VectorXd::Ones(1);
    for (const double tolerance : {0.0, -1.0, std::numeric_limits<double>::quiet_NaN()})
        CHECK_THROWS_WITH(check_of<Kink>(x0, {1.0}, {.relative_tolerance = tolerance, .flow = {}}),
                          ContainsSubstring("relative_tolerance"));
    CHECK_THROWS_AS(check_of<Kink>(Eigen::VectorXd::Ones(2), {1.0}), std::invalid_argument);
}

}  // namespace orbid::models::derivative_check_test
