#include "models/ensembles/extrapolated_flow.hpp"

#include <Eigen/Core>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <numbers>
#include <vector>

#include "models/catalogue/driven_pendulum.hpp"
#include "models/catalogue/registry.hpp"
#include "models/kernels/model_system.hpp"
#include "tests/catch.hpp"

namespace orbid::models::extrapolated_flow_test {

using tests::WithinAbs;

namespace {

/// x' = k x^2, y' = -y from x0 > 0: infinite after 1 / (k x0).
struct BlowUpOfTwo {
    static constexpr std::string_view name = "blow_up_of_two", summary = "leaves the numbers",
                                      equations = "x' = k x^2\ny' = -y";
    static constexpr std::array coordinates{real("x", "1"), real("y", "1")};
    static constexpr std::array parameters{Parameter{"k", "1/s", positive, 1.0, "rate"}};
    template <class T>
    static State<T, 2> rhs(const T& /*t*/, const State<T, 2>& x, const Values<T, 1>& p) {
        return {p[0] * x[0] * x[0], -x[1]};
    }
};
static_assert(ExtrapolatedModel<BlowUpOfTwo> && ExtrapolatedModel<DrivenPendulum>);

/// Largest difference of states, and of sensitivities in units of the largest.
std::array<double, 2> difference(const FlowResult& a, const FlowResult& b) {
    return {(a.states - b.states).lpNorm<Eigen::Infinity>(),
            (a.sensitivities - b.sensitivities).lpNorm<Eigen::Infinity>() / b.sensitivities.lpNorm<Eigen::Infinity>()};
}

}  // namespace

TEST_CASE("the weights of the extrapolation leave no power below the sixteenth", "[flow]") {
    for (const std::size_t first : {0, 1}) {
        const auto weights = Extrapolation::weights(first);
        for (std::size_t power = 0; power < Extrapolation::sequences - first; ++power) {
            long double sum = 0.0L, size = 0.0L;
            for (std::size_t j = 0; j < Extrapolation::sequences; ++j) {
                const long double term =
                    weights[j] * std::pow(static_cast<long double>(Extrapolation::counts[j]) / 8.0L,
                                          -2.0L * static_cast<long double>(power));
                sum += term;
                size += std::abs(term);
            }
            CHECK(std::abs(static_cast<double>(sum) - (power == 0 ? 1.0 : 0.0)) < 1e-15 * static_cast<double>(size));
        }
    }
}

TEST_CASE("one extrapolated step errs with the seventeenth power of its length at least", "[flow]") {
    const auto system = make_system("driven_pendulum");
    Eigen::VectorXd theta = system->default_parameters();
    theta[1] = 0.0;
    const Eigen::Vector2d x0(0.01, 0.02);
    const auto error = [&](double length) {
        // A tolerance of a whole unit accepts the first step.
        const FlowStart start{x0.data(), 0.3, theta.data(), Clock::time, {1.0, 1.0}};
        const Values<Dual<6>, 3> p{theta[0], theta[1], theta[2]};
        ExtrapolatedFlow<DrivenPendulum, 6> flow(p, start, DrivenPendulum());
        REQUIRE(flow.advance(length));
        REQUIRE(flow.steps() == 1);
        const std::array<double, 1> duration{length};
        const Eigen::VectorXd exact = system->flow(x0, 0.3, duration, theta, Clock::time, {1e-15, 1e-15}).states.col(0);
        return std::hypot(flow.state()[0].value - exact[0], flow.state()[1].value - exact[1]);
    };
    const double longer = error(6.0), shorter = error(4.0);
    CAPTURE(longer, shorter);
    // Where errors are above rounding, terms of higher order still outweigh the seventeenth power: measured 21.
    CHECK(longer > 1e5 * std::numeric_limits<double>::epsilon());
    CHECK(std::log(longer / shorter) / std::log(1.5) > 16.5);
}

TEST_CASE("extrapolated flows keep the tolerance on values and derivatives", "[flow]") {
    for (const char* name : {"driven_pendulum", "duffing", "van_der_pol", "fitzhugh_nagumo", "lotka_volterra"}) {
        const auto system = make_system(name);
        const Eigen::VectorXd theta = system->default_parameters();
        std::vector<Eigen::Index> free;
        for (Eigen::Index i = 0; i < theta.size(); ++i)
            free.push_back(i);
        const std::vector<double> durations{0.0, 0.7, 5.0};
        const bool forced = system->kind() == Kind::forced;
        for (const Clock clock : {Clock::time, Clock::phase}) {
            if (clock == Clock::phase && !forced) continue;
            for (const Eigen::Vector2d& x0 : {Eigen::Vector2d(0.7, 0.4), Eigen::Vector2d(1.3, 2.0)}) {
                const auto flow = [&](double tolerance) {
                    return system->flow_with_sensitivities(x0, forced ? 0.4 : 0.0, durations, theta, free, clock,
                                                           {tolerance, tolerance});
                };
                const FlowResult exact = flow(1e-14);
                for (const double tolerance : {1e-7, 1e-9, 1e-11}) {
                    const FlowResult extrapolated = flow(tolerance);
                    CAPTURE(name, tolerance, clock == Clock::phase);
                    REQUIRE(extrapolated.status == FlowStatus::ok);
                    CHECK(extrapolated.steps < exact.steps / 2);
                    const auto [state, sensitivity] = difference(extrapolated, exact);
                    CHECK(state < 100.0 * tolerance);
                    CHECK(sensitivity < 100.0 * tolerance);
                    // Derivatives change nothing of the values.
                    const FlowResult values =
                        system->flow(x0, forced ? 0.4 : 0.0, durations, theta, clock, {tolerance, tolerance});
                    CHECK(values.states == extrapolated.states);
                }
            }
        }
    }
}

TEST_CASE("what the extrapolation cannot follow ends as it does by single steps", "[flow]") {
    const ModelSystem<BlowUpOfTwo> system;
    const Eigen::VectorXd theta = system.default_parameters();
    const Eigen::Vector2d x0(0.5, 1.0);
    const std::vector<double> durations{1.0, 3.0};
    for (const double tolerance : {1e-9, 1e-13}) {
        const FlowResult flow = system.flow(x0, 0.0, durations, theta, Clock::time, {tolerance, tolerance});
        CHECK(flow.status == FlowStatus::not_finite);
        CHECK_THAT(flow.stopped_after, WithinAbs(2.0, 1e-6));
    }
    FlowOptions few{1e-9, 1e-9};
    few.maximum_steps = 2;
    CHECK(system.flow(x0, 0.0, durations, theta, Clock::time, few).status == FlowStatus::step_budget);
    // At rest: neither errors nor states have a size.
    const auto pendulum = make_system("driven_pendulum");
    Eigen::VectorXd still = pendulum->default_parameters();
    still[1] = 0.0;
    const std::vector<double> turn{6.0};
    const FlowResult rest = pendulum->flow(Eigen::Vector2d::Zero(), 0.0, turn, still, Clock::time, {1e-9, 1e-300});
    REQUIRE(rest.status == FlowStatus::ok);
    CHECK(rest.states.col(0).isZero());
}

}  // namespace orbid::models::extrapolated_flow_test
