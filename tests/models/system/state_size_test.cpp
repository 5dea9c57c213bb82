// States far from 1: absolute tolerances count in the size that a system is told.

#include <array>
#include <cmath>
#include <vector>

#include "models/catalogue/registry.hpp"
#include "models/system/system.hpp"
#include "tests/catch.hpp"

namespace state_size_test {

using namespace orbid::models;

namespace {

/// The Duffing oscillator in units in which its states are `unit` times as large: alpha x + beta x^3 scales with them.
struct Duffing {
    explicit Duffing(double unit) : theta(system->default_parameters()) {
        theta[system->parameter_index("gamma")] *= unit;
        theta[system->parameter_index("beta")] /= unit * unit;
        start = unit * Eigen::Vector2d(0.7, -0.2);
    }
    std::shared_ptr<const System> system = make_system("duffing");
    Eigen::VectorXd theta;
    Eigen::VectorXd start;
};

const std::vector<double> durations{1.0, 20.0};

}  // namespace

TEST_CASE("flows of small states are those of states of size 1, bit for bit", "[models][state_size]") {
    const double unit = std::ldexp(1.0, -70);
    const Duffing one(1.0), small(unit);
    const std::vector<Eigen::Index> free{one.system->parameter_index("alpha")};
    const auto sized = small.system->with_state_size(unit);
    CHECK(sized->state_size() == unit);
    CHECK(one.system->state_size() == 1.0);
    const auto wanted = one.system->flow_with_sensitivities(one.start, 0.3, durations, one.theta, free, Clock::time);
    const auto found = sized->flow_with_sensitivities(small.start, 0.3, durations, small.theta, free, Clock::time);
    REQUIRE(found.status == FlowStatus::ok);
    CHECK(found.states == unit * wanted.states);
    // Blocks of many flows as well.
    const std::vector<double> phases(24, 0.3);
    const auto many = one.system->flows(one.start.replicate(1, 24), phases, durations, one.theta, free, Clock::time);
    const auto block = sized->flows(small.start.replicate(1, 24), phases, durations, small.theta, free, Clock::time);
    for (std::size_t k = 0; k < many.size(); ++k)
        CHECK(block[k].states == unit * many[k].states);
}

TEST_CASE("a small system that moves is not at rest", "[models][state_size]") {
    const double unit = std::ldexp(1.0, -70);
    const Duffing small(unit);
    CHECK(small.system->at_rest(small.start, small.theta));  // by rates of 1e-21
    CHECK_FALSE(small.system->with_state_size(unit)->at_rest(small.start, small.theta));
    const auto lorenz = make_system("lorenz")->with_state_size(unit);
    CHECK(lorenz->at_rest(Eigen::Vector3d::Zero(), lorenz->default_parameters()));
    CHECK_FALSE(lorenz->at_rest(Eigen::Vector3d(unit, 0.0, 0.0), lorenz->default_parameters()));
}

TEST_CASE("a size of states that is none is refused", "[models][state_size]") {
    const auto system = make_system("duffing");
    for (const double size : {0.0, -1.0, std::nan(""), HUGE_VAL})
        CHECK_THROWS_AS(system->with_state_size(size), std::invalid_argument);
}

}  // namespace state_size_test
