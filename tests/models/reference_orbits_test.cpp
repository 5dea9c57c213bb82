#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <numbers>

#include "models/registry.hpp"
#include "tests/catch.hpp"

namespace orbid::models {
namespace {

struct Cycle {
    int period;
    int rotation;
    double unstable, stable;
    std::vector<Eigen::Vector2d> points;
};

struct Table {
    Eigen::VectorXd theta;
    std::vector<Cycle> cycles;
};

// tests/reference/pendulum_orbits_*.json: extended precision, 16th-order extrapolation, velocity zeros located,
// checked in quadruple precision (see "note" in the files).
Table table(const std::string& file, const System& system) {
    std::ifstream in(std::string(ORBID_SOURCE_DIR) + "/tests/reference/" + file);
    const auto json = nlohmann::json::parse(in);
    Table t{system.default_parameters(), {}};
    for (const auto& [name, value] : json["parameters"].items())
        t.theta[system.parameter_index(name)] = value.get<double>();
    for (const auto& c : json["cycles"]) {
        Cycle cycle{c["period"], c["rotation"], c["unstable_multiplier"], c["stable_multiplier"], {}};
        for (const auto& p : c["points"])
            cycle.points.emplace_back(p[0].get<double>(), p[1].get<double>());
        t.cycles.push_back(cycle);
    }
    return t;
}

}  // namespace

TEST_CASE("points of the reference cycles of the pendulum map onto each other", "[models][reference]") {
    const auto system = make_system("parametric_pendulum");
    for (const char* file : {"pendulum_orbits_g9.81.json", "pendulum_orbits_g9.8348933.json"}) {
        const Table t = table(file, *system);
        REQUIRE(t.cycles.size() > 10);
        double worst = 0, worst_turns = 0;
        for (const Cycle& cycle : t.cycles) {
            CAPTURE(file, cycle.period, cycle.rotation, cycle.unstable);
            const std::size_t p = cycle.points.size();
            double turned = 0.0;
            for (std::size_t i = 0; i < p; ++i) {
                const std::array<double, 1> durations{2.0 * std::numbers::pi};
                const FlowResult flow =
                    system->flow_with_sensitivities(cycle.points[i], 0.0, durations, t.theta, {}, Clock::phase);
                REQUIRE(flow.status == FlowStatus::ok);
                const Eigen::Vector2d image = flow.states.col(0);
                const Eigen::Vector2d next = cycle.points[(i + 1) % p];
                // Positions are good to 1e-12 and are stretched by the derivative of the map.
                const double stretch = 1.0 + flow.sensitivities.norm();
                const double error = std::hypot(wrapped(image[0] - next[0]), image[1] - next[1]);
                worst = std::max(worst, error / stretch);
                CHECK(error < 1e-9 * 1);
                turned += (image[0] - cycle.points[i][0]) - wrapped(next[0] - cycle.points[i][0]);
                (void)worst_turns;
            }
        }
        WARN(worst);
    }
}

}  // namespace orbid::models
