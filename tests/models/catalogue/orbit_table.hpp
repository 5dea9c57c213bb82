#pragma once

#include <Eigen/Core>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "models/system/system.hpp"
#include "tests/source_folder.hpp"

namespace orbid::tests {

struct Cycle {
    int period;
    int rotation;
    double unstable;
    double stable;
    std::vector<Eigen::Vector2d> points;
};

struct OrbitTable {
    Eigen::VectorXd theta;
    std::vector<Cycle> cycles;
};

/// tests/reference/pendulum_orbits_<g>.json: independent computation in extended precision (16th-order extrapolation,
/// velocity zeros located), positions checked to 1e-12 in quadruple precision; see "note" in the files.
inline OrbitTable orbit_table(const std::string& g, const models::System& system) {
    std::ifstream in(orbid::tests::source_folder() + "/tests/reference/pendulum_orbits_" + g + ".json");
    const auto json = nlohmann::json::parse(in);
    OrbitTable table{system.default_parameters(), {}};
    for (const auto& [name, value] : json["parameters"].items())
        table.theta[system.parameter_index(name)] = value.get<double>();
    for (const auto& c : json["cycles"]) {
        Cycle cycle{c["period"], c["rotation"], c["unstable_multiplier"], c["stable_multiplier"], {}};
        for (const auto& p : c["points"])
            cycle.points.emplace_back(p[0].get<double>(), p[1].get<double>());
        table.cycles.push_back(cycle);
    }
    return table;
}

}  // namespace orbid::tests
