#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <cmath>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>
#include <numbers>
#include <string>

#include "models/catalogue/registry.hpp"
#include "models/kernels/model_kernel.hpp"
#include "models/system/kernel_system.hpp"
#include "tests/catch.hpp"
#include "tests/source_folder.hpp"

namespace orbid::models::section_test {

using tests::ContainsSubstring;
using tests::WithinAbs;
using tests::WithinRel;

namespace {

constexpr double pi = std::numbers::pi;
using Free = std::vector<Eigen::Index>;

/// q'' = -w^2 q.
struct Spring {
    static constexpr std::string_view name = "spring", summary = "", equations = "";
    static constexpr std::array coordinates{real("q", "1"), real("v", "1/s")};
    static constexpr std::array parameters{Parameter{"w", "1/s", positive, 1.0, "frequency"}};
    template <class T>
    static State<T, 2> rhs(const T& /*t*/, const State<T, 2>& x, const Values<T, 1>& p) {
        return {x[1], -p[0] * p[0] * x[0]};
    }
};

/// q' = p + q (1 - q^2 - p^2), p' = -q + p (1 - q^2 - p^2): the radius obeys r' = r (1 - r^2), the angle turns
/// clockwise at one radian per second.
struct LimitCycle {
    static constexpr std::string_view name = "limit_cycle", summary = "", equations = "";
    static constexpr std::array coordinates{real("q", "1"), real("p", "1")};
    static constexpr std::array parameters{Parameter{"mu", "1/s", positive, 1.0, "growth"}};
    template <class T>
    static State<T, 2> rhs(const T& /*t*/, const State<T, 2>& x, const Values<T, 1>& p) {
        const T growth = p[0] - x[0] * x[0] - x[1] * x[1];
        return {x[1] + x[0] * growth, -x[0] + x[1] * growth};
    }
};

/// q'' = -q - mu sgn(q').
struct DrySpring {
    static constexpr std::string_view name = "dry_spring", summary = "", equations = "";
    static constexpr std::array coordinates{real("q", "1"), real("v", "1/s")};
    static constexpr std::array parameters{Parameter{"mu", "1", nonnegative, 0.1, "friction over stiffness"}};
    static bool smooth(const Values<double, 1>& p) { return p[0] == 0.0; }
    template <class T>
    static State<T, 2> rhs(const T& /*t*/, const State<T, 2>& x, const Values<T, 1>& p, double side) {
        return {x[1], -x[0] - p[0] * side};
    }
};

/// q'' = -a.
struct Throw {
    static constexpr std::string_view name = "throw", summary = "", equations = "";
    static constexpr std::array coordinates{real("q", "m"), real("v", "m/s")};
    static constexpr std::array parameters{Parameter{"a", "m/s^2", positive, 1.0, "gravity"}};
    template <class T>
    static State<T, 2> rhs(const T& /*t*/, const State<T, 2>& x, const Values<T, 1>& p) {
        return {x[1], -p[0]};
    }
};

/// A ball on a floor: q'' = -g, and v+ = -e v- at q = 0.
struct Ball {
    static constexpr std::string_view name = "ball", summary = "", equations = "";
    static constexpr std::array coordinates{real("q", "m"), real("v", "m/s")};
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
        return {x[0], -p[1] * x[1]};
    }
};

/// q' = q^2: infinite at t = 1 / q(0).
struct Burst {
    static constexpr std::string_view name = "burst", summary = "", equations = "";
    static constexpr std::array coordinates{real("q", "1")};
    static constexpr std::array parameters{Parameter{"a", "1/s", positive, 1.0, "rate"}};
    template <class T>
    static State<T, 1> rhs(const T& /*t*/, const State<T, 1>& x, const Values<T, 1>& p) {
        return {p[0] * x[0] * x[0]};
    }
};

template <class M>
std::shared_ptr<const System> system_of() {
    return std::make_shared<KernelSystem>(std::make_shared<ModelKernel<M>>());
}

Section plane(std::initializer_list<double> normal, double offset, int direction) {
    Section section{Eigen::VectorXd(static_cast<Eigen::Index>(normal.size())), offset, direction};
    Eigen::Index i = 0;
    for (const double entry : normal)
        section.normal[i++] = entry;
    return section;
}

Eigen::VectorXd vector(std::initializer_list<double> entries) {
    return plane(entries, 0.0, 1).normal;
}

}  // namespace

TEST_CASE("crossings of an oscillation have their closed form, with derivatives", "[models][fast]") {
    // q = A sin(w t + phi): q0 = A sin phi, v0 = A w cos phi; q = c rising at w t = asin(c / A) - phi + 2 pi k, falling
    // at pi - asin(c / A) - phi + 2 pi k; there v = +-w B, B = sqrt(A^2 - c^2).
    const auto system = system_of<Spring>();
    const double w = 1.7, q0 = 0.4, v0 = -1.1, c = 0.3;
    const double A = std::hypot(q0, v0 / w), phi = std::atan2(w * q0, v0), B = std::sqrt(A * A - c * c);
    for (const int direction : {1, -1}) {
        CAPTURE(direction);
        const double at = direction > 0 ? std::asin(c / A) : pi - std::asin(c / A);
        const auto result = system->crossings(vector({q0, v0}), plane({1.0, 0.0}, c, direction), 5, 10.0, vector({w}),
                                              Free{0}, {1e-13, 1e-13});
        REQUIRE(result.status == FlowStatus::ok);
        REQUIRE(result.times.size() == 5);
        const double before = std::fmod(at - phi + 4.0 * pi, 2.0 * pi);
        for (Eigen::Index k = 0; k < 5; ++k) {
            const double t = (before + 2.0 * pi * static_cast<double>(k)) / w;
            const double v = direction * w * B;
            // Measured 2.2e-14, 7.5e-14; derivatives of time 8.7e-14, of the velocity 4.3e-13: ten times that.
            CHECK_THAT(result.times[k], WithinAbs(t, 2.2e-13));
            CHECK_THAT(result.states(0, k), WithinAbs(c, 4e-16));
            CHECK_THAT(result.states(1, k), WithinAbs(v, 7.5e-13));
            // A^2 = q0^2 + v0^2 / w^2; d asin(c / A) = -(c / (A B)) dA; d phi of atan2(w q0, v0).
            const Eigen::Vector3d dA(q0 / A, v0 / (w * w * A), -v0 * v0 / (w * w * w * A));
            const double square = w * w * q0 * q0 + v0 * v0;
            const Eigen::Vector3d dphi(w * v0 / square, -w * q0 / square, q0 * v0 / square);
            Eigen::Vector3d dt = (-direction * c / (A * B) * dA - dphi) / w;
            dt[2] -= t / w;
            Eigen::Vector3d dv = direction * w * A / B * dA;
            dv[2] += direction * B;
            CHECK((result.time_sensitivities.col(k) - dt).norm() < 8.7e-13);
            CHECK((result.sensitivities.middleCols(3 * k, 3).row(1).transpose() - dv).norm() < 4.3e-12);
            CHECK(result.sensitivities.middleCols(3 * k, 3).row(0).norm() < 1e-14);
        }
        CHECK(result.stopped_after == result.times[4]);
        CHECK(result.stopped_state == result.states.col(4));
    }
}

TEST_CASE("the return map of a limit cycle has its closed form", "[models][fast]") {
    // 1 / r^2 - 1 shrinks by exp(-4 pi) in every turn of 2 pi, so dr1 / dr0 = (r1 / r0)^3 exp(-4 pi).
    const auto system = system_of<LimitCycle>();
    const double shrinking = std::exp(-4.0 * pi);
    for (const double r0 : {1.0, 0.5, 2.0}) {
        CAPTURE(r0);
        const auto result = system->crossings(vector({r0, 0.0}), plane({0.0, 1.0}, 0.0, -1), 3, 10.0, vector({1.0}),
                                              Free{}, {1e-13, 1e-13});
        REQUIRE(result.status == FlowStatus::ok);
        const double r1 = 1.0 / std::sqrt(1.0 + (1.0 / (r0 * r0) - 1.0) * shrinking);
        // Measured 1.2e-13 s and 2.4e-14: ten times that.
        for (Eigen::Index k = 0; k < 3; ++k)
            CHECK_THAT(result.times[k], WithinAbs(2.0 * pi * static_cast<double>(k + 1), 1.2e-12));
        CHECK_THAT(result.states(0, 0), WithinAbs(r1, 2.4e-13));
        CHECK_THAT(result.states(1, 0), WithinAbs(0.0, 1e-15));
        // The small rest of numbers of size one (3.5e-6 on the cycle): measured 4.1e-15, ten times that.
        CHECK_THAT(result.sensitivities(0, 0), WithinAbs(std::pow(r1 / r0, 3) * shrinking, 4e-14));
        CHECK(result.sensitivities.row(1).norm() < 1e-14);
        // Along the flow nothing but the time changes: on the circle p moves the start by dt = -p.
        if (r0 == 1.0) {
            CHECK_THAT(result.sensitivities(0, 1), WithinAbs(0.0, 4e-13));
            CHECK_THAT(result.time_sensitivities(1, 0), WithinAbs(1.0, 4e-13));
            CHECK_THAT(result.time_sensitivities(0, 0), WithinAbs(0.0, 4e-13));
        }
    }
}

TEST_CASE("cycles of the Lorenz equations return to the section, with period and multiplier", "[models][reference]") {
    // Cycles to 25 digits on z = 27 (tests/reference/README.md). One letter of the code is one turn around a roll, and
    // every turn rises through z = 27 once.
    std::ifstream in(orbid::tests::source_folder() + "/tests/reference/lorenz_orbits.json");
    const auto table = nlohmann::json::parse(in);
    const auto number = [](const nlohmann::json& cycle, const char* key) {
        return std::stod(cycle[key].get<std::string>());
    };
    const auto system = make_system("lorenz");
    const Section section = plane({0.0, 0.0, 1.0}, 27.0, 1);
    double worst_time = 0.0, worst_gap = 0.0, worst_multiplier = 0.0;
    REQUIRE(table["cycles"].size() == 10);
    for (const auto& cycle : table["cycles"]) {
        const auto code = cycle["code"].get<std::string>();
        CAPTURE(code);
        const Eigen::Vector3d start(number(cycle, "x"), number(cycle, "y"), 27.0);
        const double unstable = number(cycle, "unstable_multiplier");
        const auto result = system->crossings(start, section, code.size(), 5.0, system->default_parameters(), Free{});
        REQUIRE(result.status == FlowStatus::ok);
        const auto last = static_cast<Eigen::Index>(code.size()) - 1;
        worst_time = std::max(worst_time, std::abs(result.times[last] - number(cycle, "period")) / unstable);
        worst_gap = std::max(worst_gap, (result.states.col(last) - start).norm() / unstable);
        const Eigen::Matrix2d map = result.sensitivities.middleCols(3 * last, 3).topLeftCorner(2, 2);
        const double largest = map.eigenvalues().cwiseAbs().maxCoeff();
        worst_multiplier = std::max(worst_multiplier, std::abs(largest / unstable - 1.0));
        // The other one is exp(-(sigma + 1 + beta) T) / unstable by Liouville, below 1e-9: lost in the errors of the
        // entries. Measured 1.2e-10.
        CHECK(std::abs(map.determinant()) < 1.2e-9 * unstable);
    }
    // Measured 1.2e-14 s, 3.4e-13 and 3.9e-12 per unit of stretching: ten times that.
    CHECK(worst_time < 1.2e-13);
    CHECK(worst_gap < 3.5e-12);
    CHECK(worst_multiplier < 4e-11);
}

TEST_CASE("periods of the Roessler equations lie in their verified intervals", "[models][reference]") {
    // Interval arithmetic (Galias): cycles of one, two and three turns. Newton's method on the return map finds them
    // from three digits.
    struct Row {
        int turns;
        double y, z, lower, upper;
    };
    const std::array rows{Row{1, 6.09, 1.30, 5.8810884555538525, 5.8810884555539493},
                          Row{2, 3.92, 3.69, 11.758626071659574, 11.758626071660617},
                          Row{3, 2.28, 7.42, 17.515791070334913, 17.515791070336615}};
    const auto system = make_system("rossler");
    const Section section = plane({1.0, 0.0, 0.0}, 0.0, -1);
    for (const Row& row : rows) {
        CAPTURE(row.turns);
        Eigen::Vector3d x(0.0, row.y, row.z);
        double period = 0.0, move = 1.0;
        for (int i = 0; i < 8 && move > 1e-13; ++i) {
            const auto result = system->crossings(x, section, static_cast<std::size_t>(row.turns), 20.0,
                                                  system->default_parameters(), Free{}, {1e-15, 1e-15});
            REQUIRE(result.status == FlowStatus::ok);
            const Eigen::Index last = row.turns - 1;
            const Eigen::Matrix2d map = result.sensitivities.middleCols(3 * last, 3).bottomRightCorner(2, 2);
            const Eigen::Vector2d gap = result.states.col(last).tail(2) - x.tail(2);
            const Eigen::Vector2d step = (Eigen::Matrix2d::Identity() - map).lu().solve(gap);
            x.tail(2) += step;
            move = step.norm();
            period = result.times[last];
        }
        CAPTURE(move);
        CHECK(move < 1e-12);
        CAPTURE(period - 0.5 * (row.lower + row.upper));
        CHECK(row.lower <= period);
        CHECK(period <= row.upper);
    }
}

TEST_CASE("derivatives of returns agree with differences", "[models][fast]") {
    struct Row {
        const char* model;
        Eigen::Vector3d start;
        Section section;
    };
    const std::vector<Row> rows{{"lorenz", {-5.0, -7.0, 20.0}, plane({0.2, -0.3, 1.0}, 25.0, -1)},
                                {"rossler", {1.0, -5.0, 0.3}, plane({1.0, 0.2, -0.1}, 0.4, 1)}};
    for (const Row& row : rows) {
        CAPTURE(row.model);
        const auto system = make_system(row.model);
        const Eigen::VectorXd theta = system->default_parameters();
        const FlowOptions options{1e-14, 1e-14};
        const auto result = system->crossings(row.start, row.section, 3, 50.0, theta, Free{0, 1, 2}, options);
        REQUIRE(result.status == FlowStatus::ok);
        for (Eigen::Index j = 0; j < 6; ++j) {
            CAPTURE(j);
            // Central differences: truncation h^2 times third derivatives (up to 1e6 after three turns) over rounding
            // 1e-12 / h.
            const double h = 1e-5;
            Eigen::VectorXd up = row.start, down = row.start, more = theta, less = theta;
            if (j < 3) {
                up[j] += h;
                down[j] -= h;
            } else {
                more[j - 3] += h;
                less[j - 3] -= h;
            }
            const auto above = system->crossings(up, row.section, 3, 50.0, more, std::nullopt, options);
            const auto below = system->crossings(down, row.section, 3, 50.0, less, std::nullopt, options);
            for (Eigen::Index k = 0; k < 3; ++k) {
                const Eigen::Vector3d slope = (above.states.col(k) - below.states.col(k)) / (2.0 * h);
                const Eigen::Vector3d exact = result.sensitivities.col(6 * k + j);
                CHECK((slope - exact).norm() < 1e-6 * (1.0 + exact.norm()));
                const double time_slope = (above.times[k] - below.times[k]) / (2.0 * h);
                CHECK_THAT(result.time_sensitivities(j, k), WithinAbs(time_slope, 1e-6 * (1.0 + std::abs(time_slope))));
                // The crossing moves along the plane.
                CHECK(std::abs(row.section.normal.dot(exact)) < 1e-12 * (1.0 + exact.norm()));
            }
        }
    }
}

TEST_CASE("values of crossings do not depend on which derivatives are asked for", "[models][fast]") {
    const auto system = make_system("lorenz");
    const Eigen::VectorXd theta = system->default_parameters();
    const Eigen::Vector3d start(1.0, 2.0, 20.0);
    const Section section = plane({0.0, 0.0, 1.0}, 27.0, -1);
    const auto with = system->crossings(start, section, 20, 5.0, theta, Free{});
    REQUIRE(with.times.size() == 20);
    for (const Free& free : {Free{2}, Free{2, 0}, Free{2, 0, 1}}) {
        const auto more = system->crossings(start, section, 20, 5.0, theta, free);
        CHECK(more.states == with.states);
        CHECK(more.times == with.times);
        CHECK(more.steps == with.steps);
        REQUIRE(more.sensitivities.cols() == 20 * (3 + static_cast<Eigen::Index>(free.size())));
    }
    const auto one = system->crossings(start, section, 20, 5.0, theta, Free{1});
    const auto all = system->crossings(start, section, 20, 5.0, theta, Free{0, 1, 2});
    CHECK(one.sensitivities.col(3) == all.sensitivities.col(4));
    CHECK(one.time_sensitivities.row(3) == all.time_sensitivities.row(4));

    // Without derivatives the steps are others: errors of 1e-12, stretched by exp(0.9 t) over 15 s.
    const auto plain = system->crossings(start, section, 20, 5.0, theta);
    REQUIRE(plain.times.size() == 20);
    CHECK(plain.sensitivities.cols() == 0);
    CHECK((plain.states.leftCols(5) - with.states.leftCols(5)).norm() < 1e-8);
    const Eigen::MatrixXd starts = (Eigen::MatrixXd(3, 2) << 1.0, -3.0, 2.0, 1.0, 20.0, 15.0).finished();
    const auto many = system->crossing_ensemble(starts, section, 20, 5.0, theta);
    REQUIRE(many.sections.size() == 2);
    CHECK(many.sections[0].col(0) == start);
    CHECK(many.sections[0].rightCols(20) == plain.states);
    CHECK(many.times[0][0] == 0.0);
    CHECK(many.times[0].tail(20) == plain.times);
    CHECK(many.status[1] == FlowStatus::ok);
    // Derivatives would have left the range of numbers after 800 s.
    const auto longer = system->crossing_ensemble(starts, section, 2000, 5.0, theta);
    CHECK(longer.status[0] == FlowStatus::ok);
    CHECK(longer.times[0][2000] > 1000.0);
}

TEST_CASE("a chaotic flow lives longer than its derivatives", "[models][fast]") {
    // exp(0.9 t) leaves the range of numbers at t = 780 s.
    const auto system = make_system("lorenz");
    const Eigen::VectorXd theta = system->default_parameters();
    const Eigen::Vector3d start(1.0, 2.0, 20.0);
    const std::vector<double> durations{1.0, 1500.0};
    const auto plain = system->flow(start, 0.0, durations, theta, Clock::time);
    CHECK(plain.status == FlowStatus::ok);
    CHECK(plain.states.cwiseAbs().maxCoeff() < 50.0);
    const auto with = system->flow_with_sensitivities(start, 0.0, durations, theta, Free{}, Clock::time);
    CHECK(with.status == FlowStatus::not_finite);
    CHECK(with.stopped_after > 600.0);
    CHECK((with.states.col(0) - plain.states.col(0)).norm() < 1e-11);
}

TEST_CASE("crossings are as accurate as the flow, whatever the steps", "[models][fast]") {
    const auto system = make_system("lorenz");
    const Eigen::VectorXd theta = system->default_parameters();
    const Eigen::Vector3d start(-5.0, -7.0, 20.0);
    const Section section = plane({0.0, 0.0, 1.0}, 27.0, 1);
    const auto exact = system->crossings(start, section, 3, 5.0, theta, Free{}, {1e-15, 1e-15});
    REQUIRE(exact.status == FlowStatus::ok);
    double before = 0.0;
    for (const double tolerance : {1e-4, 1e-6, 1e-8, 1e-10, 1e-12}) {
        const auto result = system->crossings(start, section, 3, 5.0, theta, Free{}, {tolerance, tolerance});
        REQUIRE(result.status == FlowStatus::ok);
        const double error = (result.times - exact.times).norm();
        CAPTURE(tolerance, error, result.steps);
        // Errors of states of size thirty that are stretched by up to twenty; a time is a distance over a speed of 200.
        CHECK(error < 100.0 * tolerance);
        if (before > 0.0) CHECK(error < 0.2 * before);
        before = error;
        CHECK((result.states.row(2).array() - 27.0).abs().maxCoeff() < 1e-14 * 27.0);
        // The flow is there at that time: only its last step is another one.
        const std::vector<double> times(result.times.data(), result.times.data() + 3);
        const auto flow = system->flow(start, 0.0, times, theta, Clock::time, {1e-15, 1e-15});
        CHECK((flow.states - result.states).norm() < 1000.0 * tolerance);
    }
}

TEST_CASE("a start on the plane is no crossing, its image is", "[models][fast]") {
    const auto system = system_of<Spring>();
    const Eigen::VectorXd w = vector({1.0});
    for (const int direction : {1, -1}) {
        // Rising through 0 at the start.
        const auto result = system->crossings(vector({0.0, 1.0}), plane({1.0, 0.0}, 0.0, direction), 1, 10.0, w);
        CHECK_THAT(result.times[0], WithinAbs(direction > 0 ? 2.0 * pi : pi, 1e-11));
    }
    // The image of a crossing as the next start, on a plane where rounding leaves it on either side.
    const auto lorenz = make_system("lorenz");
    const Section section = plane({0.3, -0.7, 1.1}, 20.0, 1);
    const auto whole =
        lorenz->crossings(Eigen::Vector3d(1.0, 2.0, 20.0), section, 30, 5.0, lorenz->default_parameters());
    REQUIRE(whole.times.size() == 30);
    for (Eigen::Index k = 0; k + 1 < 30; ++k) {
        const Eigen::VectorXd start = whole.states.col(k);
        const auto next = lorenz->crossings(start, section, 1, 5.0, lorenz->default_parameters());
        REQUIRE(next.times.size() == 1);
        // The steps begin anew: errors of 1e-12, stretched.
        CHECK_THAT(next.times[0], WithinAbs(whole.times[k + 1] - whole.times[k], 1e-10));
    }
}

TEST_CASE("a crossing there and back within one step is noticed", "[models][fast]") {
    const auto system = system_of<Spring>();
    const Eigen::VectorXd w = vector({1.0});
    // q = cos t reaches 1 - d only within sqrt(2 d) around t = 2 pi k.
    for (const double d : {1e-2, 1e-5, 1e-8, 1e-11}) {
        CAPTURE(d);
        const double half = std::acos(1.0 - d);
        for (const int direction : {1, -1}) {
            // The error of cos is amplified by 1 / sin: 2e-12 / sqrt(2 d).
            const double bound = 2e-12 * (1.0 + 1.0 / std::sqrt(2.0 * d));
            const auto hump = system->crossings(vector({-1.0, 0.0}), plane({1.0, 0.0}, 1.0 - d, direction), 3, 10.0, w,
                                                std::nullopt, {1e-14, 1e-14});
            REQUIRE(hump.times.size() == 3);
            const auto dip = system->crossings(vector({1.0, 0.0}), plane({1.0, 0.0}, d - 1.0, direction), 3, 10.0, w,
                                               std::nullopt, {1e-14, 1e-14});
            REQUIRE(dip.times.size() == 3);
            for (Eigen::Index k = 0; k < 3; ++k) {
                const double turn = pi + 2.0 * pi * static_cast<double>(k);
                CHECK_THAT(hump.times[k], WithinAbs(turn - direction * half, bound));
                CHECK_THAT(dip.times[k], WithinAbs(turn + direction * half, bound));
            }
        }
    }
    // Steps of a loose tolerance are longer than a quarter of a turn.
    const auto loose =
        system->crossings(vector({1.0, 0.0}), plane({1.0, 0.0}, 0.9, 1), 40, 20.0, w, std::nullopt, {1e-3, 1e-3});
    REQUIRE(loose.times.size() == 40);
    CHECK(loose.steps < 40 * 8);
    for (Eigen::Index k = 0; k + 1 < 40; ++k)
        CHECK_THAT(loose.times[k + 1] - loose.times[k], WithinAbs(2.0 * pi, 0.1));
}

TEST_CASE("a plane that is only touched is named", "[models][fast]") {
    // q = -(1 - t)^2 from q = -1, which every step of the integrator follows but for rounding.
    const auto system = system_of<Throw>();
    const auto towards = [&](double offset, int direction) {
        return system->crossings(vector({-1.0, 2.0}), plane({1.0, 0.0}, offset, direction), 1, 4.0, vector({2.0}),
                                 Free{0});
    };
    for (const int direction : {1, -1}) {
        CAPTURE(direction);
        CHECK(towards(0.0, direction).status == FlowStatus::grazing);
        CHECK(towards(0.0, direction).times.size() == 0);
        CHECK(towards(1e-12, direction).status == FlowStatus::no_crossing);
        CHECK(towards(1e-12, direction).stopped_after == 4.0);
        const auto barely = towards(-1e-12, direction);
        REQUIRE(barely.status == FlowStatus::ok);
        // q known to 1e-15 says the time 1e-6 before and behind the top to 1e-9.
        CHECK_THAT(barely.times[0], WithinAbs(1.0 - direction * 1e-6, 5e-9));
        // v = 2 sqrt(1e-12), dt / dq0 = -1 / v to the same three digits.
        CHECK_THAT(barely.time_sensitivities(0, 0), WithinRel(-0.5e6 * direction, 5e-3));
    }
}

TEST_CASE("crossings between events of dry friction have their closed form", "[models][fast]") {
    // From (q0, 0), q0 > 0: half turns around +mu and -mu in turn, each shortening the swing by 2 mu. In the half turn
    // number j (0, 1, ...) q = s (mu + (q0 - (2 j + 1) mu) cos(t - pi j)), s = (-1)^j, falls through 0 for even j.
    const auto system = system_of<DrySpring>();
    const double q0 = 1.03, mu = 0.07;
    const auto result =
        system->crossings(vector({q0, 0.0}), plane({1.0, 0.0}, 0.0, -1), 10, 10.0, vector({mu}), Free{0});
    // Halves 0, 2, 4, 6; the mass is held where |q| <= mu: after half 6 at -0.05.
    CHECK(result.status == FlowStatus::no_crossing);
    REQUIRE(result.times.size() == 4);
    CHECK_THAT(result.stopped_after, WithinAbs(result.times[3] + 10.0, 1e-12));
    CHECK_THAT(result.stopped_state[0], WithinAbs(-(q0 - 14.0 * mu), 1e-11));
    for (Eigen::Index k = 0; k < 4; ++k) {
        const double j = 2.0 * static_cast<double>(k), swing = q0 - (2.0 * j + 1.0) * mu;
        const double t = pi * j + std::acos(-mu / swing), speed = std::sqrt(swing * swing - mu * mu);
        CAPTURE(k);
        // Measured 2.0e-12, 3.9e-13; derivatives 3.5e-11 and 5.2e-10 of time, 7.3e-13 and 1.7e-11 of velocity: ten
        // times.
        CHECK_THAT(result.times[k], WithinAbs(t, 2e-11));
        CHECK_THAT(result.states(1, k), WithinAbs(-speed, 4e-12));
        // t = pi j + acos(u), u = -mu / swing: dt = -du / sqrt(1 - u^2) = -du swing / speed, v = -speed.
        const double by_q0 = -(mu / (swing * swing)) * swing / speed;
        const double by_mu = (1.0 / swing + mu / (swing * swing) * (2.0 * j + 1.0)) * swing / speed;
        CHECK_THAT(result.time_sensitivities(0, k), WithinAbs(by_q0, 4e-10));
        CHECK_THAT(result.time_sensitivities(2, k), WithinAbs(by_mu, 5e-9));
        CHECK_THAT(result.sensitivities(1, 3 * k), WithinAbs(-swing / speed, 1e-11));
        CHECK_THAT(result.sensitivities(1, 3 * k + 2), WithinAbs((swing * (2.0 * j + 1.0) + mu) / speed, 2e-10));
    }
}

TEST_CASE("impacts carry the state over a plane without crossing it", "[models][fast]") {
    // Dropped from h at rest: tops of e^2k h after sqrt(2 h / g) (2 (1 + e + ... e^k) - 1 - e^k), crossings of v = 0
    // from above. From below the velocity passes 0 in jumps only.
    const auto system = system_of<Ball>();
    const double g = 9.81, e = 0.8, h = 1.3;
    const auto tops =
        system->crossings(vector({h, 0.0}), plane({0.0, 1.0}, 0.0, -1), 5, 3.0, vector({g, e}), Free{0, 1});
    REQUIRE(tops.status == FlowStatus::ok);
    for (Eigen::Index k = 0; k < 5; ++k) {
        CAPTURE(k);
        const double n = static_cast<double>(k) + 1.0, share = std::pow(e, 2.0 * n);
        double sum = 0.0;
        for (Eigen::Index i = 0; i <= k + 1; ++i)
            sum += std::pow(e, static_cast<double>(i));
        const double t = std::sqrt(2.0 * h / g) * (2.0 * sum - 1.0 - std::pow(e, n));
        // A parabola is followed up to rounding, ten bounces of it.
        CHECK_THAT(tops.times[k], WithinAbs(t, 1e-13));
        CHECK_THAT(tops.states(0, k), WithinAbs(share * h, 1e-13));
        CHECK_THAT(tops.time_sensitivities(0, k), WithinAbs(0.5 * t / h, 1e-12));
        CHECK_THAT(tops.time_sensitivities(2, k), WithinAbs(-0.5 * t / g, 1e-12));
        CHECK_THAT(tops.sensitivities(0, 4 * k), WithinAbs(share, 1e-12));
        CHECK_THAT(tops.sensitivities(0, 4 * k + 3), WithinAbs(2.0 * n * share / e * h, 1e-12));
    }
    const auto never =
        system->crossings(vector({h, 0.0}), plane({0.0, 1.0}, 0.0, 1), 1, tops.times[4], vector({g, e}), Free{0});
    CHECK(never.status == FlowStatus::no_crossing);
}

TEST_CASE("the plane of an angle is met once per turn", "[models][fast]") {
    const auto system = make_system("free_pendulum");
    Eigen::VectorXd theta = Eigen::VectorXd::Zero(5);
    theta[0] = 4.0;  // phi'' = -4 sin(phi); over the top at 5 rad/s
    for (const double sign : {1.0, -1.0}) {
        const auto direction = static_cast<int>(sign);
        const auto result =
            system->crossings(vector({0.5, 5.0 * sign}), plane({1.0, 0.0}, 0.5, direction), 4, 10.0, theta, Free{});
        REQUIRE(result.status == FlowStatus::ok);
        for (Eigen::Index k = 0; k < 4; ++k) {
            CHECK_THAT(result.states(0, k), WithinAbs(0.5 + sign * 2.0 * pi * static_cast<double>(k + 1), 1e-14));
            // The energy is kept: the turns take the same time, at the same speed.
            CHECK_THAT(result.states(1, k), WithinAbs(5.0 * sign, 1e-10));
            CHECK_THAT(result.times[k], WithinRel(result.times[0] * static_cast<double>(k + 1), 1e-10));
        }
        // Never in the other direction.
        CHECK(system->crossings(vector({0.5, 5.0 * sign}), plane({1.0, 0.0}, 0.5, -direction), 1, 10.0, theta).status ==
              FlowStatus::no_crossing);
    }
}

TEST_CASE("why there is no crossing is a status", "[models][fast]") {
    const auto lorenz = make_system("lorenz");
    Eigen::VectorXd theta = lorenz->default_parameters();
    const Eigen::Vector3d start(1.0, 2.0, 20.0);
    const Section far = plane({0.0, 0.0, 1.0}, 100.0, 1);
    const auto none = lorenz->crossings(start, far, 3, 2.5, theta, Free{0});
    CHECK(none.status == FlowStatus::no_crossing);
    CHECK(none.stopped_after == 2.5);
    CHECK(none.times.size() == 0);
    CHECK(none.states.cols() == 0);
    CHECK(none.sensitivities.cols() == 0);
    const auto flow = lorenz->flow(start, 0.0, std::array{2.5}, theta, Clock::time);
    CHECK((none.stopped_state - flow.stopped_state).norm() < 1e-9);
    const Section near = plane({0.0, 0.0, 1.0}, 27.0, 1);
    const auto spent = lorenz->crossings(start, near, 3, 50.0, theta, std::nullopt, {.maximum_steps = 5});
    CHECK(spent.status == FlowStatus::step_budget);
    CHECK(spent.steps == 5);
    // The budget is one of each return.
    const auto enough = lorenz->crossings(start, near, 300, 5.0, theta, std::nullopt, {.maximum_steps = 200});
    CHECK(enough.status == FlowStatus::ok);
    CHECK(enough.steps > 200);
    // rho < 1: everything comes to rest at the origin.
    theta[1] = 0.5;
    CHECK(lorenz->crossings(start, near, 1, 100.0, theta).status == FlowStatus::no_crossing);
    const auto burst = system_of<Burst>();
    const auto infinite = burst->crossings(vector({0.5}), plane({1.0}, -1.0, 1), 1, 10.0, vector({1.0}));
    CHECK(infinite.status == FlowStatus::not_finite);
    CHECK_THAT(infinite.stopped_after, WithinRel(2.0, 1e-6));
    CHECK(burst->crossings(vector({0.5}), plane({1.0}, 1.0, 1), 0, 10.0, vector({1.0})).status == FlowStatus::ok);
    for (const FlowStatus status : {FlowStatus::no_crossing, FlowStatus::grazing})
        CHECK_FALSE(description(status).empty());
}

TEST_CASE("sections that cannot be meant are refused", "[models][fast]") {
    const auto lorenz = make_system("lorenz");
    const Eigen::VectorXd theta = lorenz->default_parameters();
    const Eigen::Vector3d start(1.0, 2.0, 20.0);
    const auto refused = [&](const Section& section, double longest, const char* rule) {
        CAPTURE(rule);
        CHECK_THROWS_AS(lorenz->crossings(start, section, 1, longest, theta), std::invalid_argument);
        CHECK_THROWS_WITH(lorenz->crossings(start, section, 1, longest, theta), ContainsSubstring(rule));
        CHECK_THROWS_WITH(lorenz->crossing_ensemble(Eigen::MatrixXd(start), section, 1, longest, theta),
                          ContainsSubstring(rule));
    };
    constexpr double nan = std::numeric_limits<double>::quiet_NaN();
    refused(plane({1.0, 0.0}, 0.0, 1), 1.0, "normal of the section has 2 entries, must have 3");
    refused(plane({0.0, 0.0, 0.0}, 0.0, 1), 1.0, "must be finite and not 0");
    refused(plane({nan, 0.0, 0.0}, 0.0, 1), 1.0, "must be finite and not 0");
    refused(plane({1.0, 0.0, 0.0}, nan, 1), 1.0, "offset of the section is nan");
    refused(plane({1.0, 0.0, 0.0}, 0.0, 0), 1.0, "direction of the section is 0, must be 1 or -1");
    refused(plane({1.0, 0.0, 0.0}, 0.0, 1), 0.0, "longest return time is 0, must be > 0");
    refused(plane({1.0, 0.0, 0.0}, 0.0, 1), nan, "longest return time is nan, must be > 0");
    for (const char* name : {"parametric_pendulum", "duffing"}) {
        const auto forced = make_system(name);
        CHECK_THROWS_AS(
            forced->crossings(vector({1.0, 0.0}), plane({1.0, 0.0}, 0.0, 1), 1, 1.0, forced->default_parameters()),
            std::logic_error);
    }
}

}  // namespace orbid::models::section_test
