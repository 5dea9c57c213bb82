// The check of derivatives at random parameter sets of every model and variant: it has no false alarm.

#include <cmath>
#include <numbers>
#include <random>
#include <string>
#include <vector>

#include "models/catalogue/registry.hpp"
#include "models/system/derivative_check.hpp"
#include "tests/catch.hpp"

namespace orbid::models::false_alarm_test {

namespace {

constexpr int sets = 25;  // with 100: 1800 checks, no false alarm, 18 s
/// Differences cost the square of the number of directions.
constexpr Eigen::Index most_directions = 30;

/// Within a factor of two of the defaults; what is 0 by default lies around it, or above it.
Eigen::VectorXd random_parameters(const System& system, std::mt19937_64& random) {
    Eigen::VectorXd theta = system.default_parameters();
    std::uniform_real_distribution<double> symmetric(-1.0, 1.0);
    for (Eigen::Index i = 0; i < theta.size(); ++i) {
        const Parameter& parameter = system.parameters()[static_cast<std::size_t>(i)];
        const double draw = symmetric(random);
        if (theta[i] != 0.0)
            theta[i] *= std::exp2(draw);
        else
            theta[i] = parameter.typical_size * (parameter.domain == Domain::real ? draw : std::abs(draw));
    }
    return theta;
}

Eigen::VectorXd random_state(const System& system, std::mt19937_64& random) {
    Eigen::VectorXd state(system.dimension());
    for (Eigen::Index i = 0; i < state.size(); ++i) {
        const double half = system.coordinates()[static_cast<std::size_t>(i)].angle ? std::numbers::pi : 1.0;
        state[i] = std::uniform_real_distribution<double>(-half, half)(random);
    }
    return state;
}

}  // namespace

TEST_CASE("right derivatives are never said to be wrong", "[models][derivative_check]") {
    std::size_t checked = 0, compared = 0;
    for (const ModelEntry& entry : registered_models()) {
        std::vector<std::string_view> variants = entry.variants;
        if (variants.empty()) variants.emplace_back();
        for (const std::string_view variant : variants) {
            const auto system = make_system(entry.name, variant);
            std::vector<Eigen::Index> free;
            for (Eigen::Index i = 0; i < std::ssize(system->parameters()); ++i)
                free.push_back(i);
            if (!system->inputs().empty() || system->dimension() + std::ssize(free) > most_directions) continue;
            std::mt19937_64 random(1);
            for (int set = 0; set < sets; ++set) {
                const Eigen::VectorXd theta = random_parameters(*system, random);
                const Eigen::VectorXd state = random_state(*system, random);
                const bool counted = system->kind() == Kind::map;
                const std::vector<double> durations = counted ? std::vector{1.0, 2.0} : std::vector{0.05, 0.3};
                const double phase = std::uniform_real_distribution<double>(0.0, 2.0 * std::numbers::pi)(random);
                const DerivativeCheck check =
                    check_derivatives(*system, state, phase, durations, theta, free, Clock::time);
                INFO(entry.name << " " << variant << ", set " << set << ": " << check.message);
                CHECK(check.passed);
                ++checked;
                compared += check.compared;
            }
        }
    }
    INFO(checked << " checks, " << compared << " entries compared");
    CHECK(checked >= 18 * sets);
    CHECK(compared >= 20 * checked);
}

}  // namespace orbid::models::false_alarm_test
