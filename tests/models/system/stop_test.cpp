// A system that asks whether to stop: all flows of it are left by Stopped, and have the same bytes when they are not.

#include <array>
#include <atomic>
#include <numbers>
#include <vector>

#include "models/catalogue/registry.hpp"
#include "models/system/stopped.hpp"
#include "models/system/system.hpp"
#include "tests/catch.hpp"

namespace stop_test {

using namespace orbid::models;

namespace {

struct Asked {
    std::atomic<int> times{0};
    int most = 1 << 30;
    [[nodiscard]] std::function<bool()> question() {
        return [this] { return ++times > most; };
    }
};

constexpr std::array<double, 2> long_durations{1e3, 1e5};

}  // namespace

TEST_CASE("every kind of flow is left when its system is asked to stop", "[models][stop]") {
    for (const char* name : {"lorenz", "parametric_pendulum", "van_der_pol", "henon", "lorenz96"}) {
        CAPTURE(name);
        const auto plain = make_system(name);
        const Eigen::VectorXd theta = plain->default_parameters();
        const Eigen::VectorXd x0 = Eigen::VectorXd::LinSpaced(plain->dimension(), 0.1, 0.2);
        Asked asked;
        asked.most = 3;
        const auto system = plain->with_stop(asked.question());
        FlowOptions options;
        options.maximum_steps = 100000000;
        CHECK_THROWS_AS(system->flow(x0, 0.0, long_durations, theta, Clock::time, options), Stopped);
        CHECK(asked.times == 4);
        CHECK_THROWS_AS(system->flow_with_sensitivities(x0, 0.0, long_durations, theta, {}, Clock::time, options),
                        Stopped);
        const Eigen::MatrixXd starts = x0.replicate(1, 40);
        const std::vector<double> phases(40, 0.0);
        CHECK_THROWS_AS(system->flows(starts, phases, long_durations, theta, std::nullopt, Clock::time, options),
                        Stopped);
        if (system->kind() != Kind::autonomous) {
            CHECK_THROWS_AS(system->ensemble(starts, 0.0, 1000000, theta), Stopped);
        } else {
            const Section section{Eigen::VectorXd::Unit(system->dimension(), 0), 0.15, 1};
            CHECK_THROWS_AS(system->crossings(x0, section, 100000, 1e6, theta, std::nullopt, options), Stopped);
        }
    }
}

TEST_CASE("a question that is never answered by yes changes no byte", "[models][stop]") {
    const auto plain = make_system("parametric_pendulum");
    const Eigen::VectorXd theta = plain->default_parameters();
    const Eigen::VectorXd x0 = Eigen::VectorXd::Constant(2, 0.3);
    Asked asked;
    const auto system = plain->with_stop(asked.question());
    const std::array<double, 2> durations{1.0, 20.0};
    const auto with = system->flow(x0, 0.0, durations, theta, Clock::phase);
    CHECK(with.states == plain->flow(x0, 0.0, durations, theta, Clock::phase).states);
    // Once per step.
    CHECK(asked.times == static_cast<int>(with.steps));
    const Eigen::MatrixXd starts = x0.replicate(1, 7);
    CHECK(system->ensemble(starts, 0.0, 20, theta).sections[6] == plain->ensemble(starts, 0.0, 20, theta).sections[6]);
}

}  // namespace stop_test
