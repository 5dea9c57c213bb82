#pragma once

#include <fstream>
#include <stdexcept>
#include <string>
#include <vector>

#include <Eigen/Core>
#include <nlohmann/json.hpp>

#include "models/system/system.hpp"
#include "tests/source_folder.hpp"

namespace orbid::tests {

/// One cycle of tests/reference/lorenz_orbits.json or rossler_orbits.json: 25-digit computation.
struct FlowOrbit {
    std::string code;
    double time = 0.0;
    double unstable_multiplier = 0.0;
    Eigen::Vector3d point;  ///< on the section
};

struct FlowOrbits {
    models::Section section;
    std::vector<FlowOrbit> orbits;
};

/// @param model  "lorenz" (z = 27 rising) or "rossler" (x = 0 falling).
inline FlowOrbits read_flow_orbits(const std::string& model) {
    std::ifstream stream(orbid::tests::source_folder() + "/tests/reference/" + model + "_orbits.json");
    if (!stream) throw std::runtime_error("cannot read the orbits of " + model);
    const auto json = nlohmann::json::parse(stream);
    const bool lorenz = model == "lorenz";
    FlowOrbits table;
    table.section = lorenz ? models::Section{Eigen::Vector3d::UnitZ(), 27.0, 1}
                           : models::Section{Eigen::Vector3d::UnitX(), 0.0, -1};
    for (const auto& entry : json.at("cycles")) {
        const auto number = [&](const char* key) { return std::stod(entry.at(key).get<std::string>()); };
        FlowOrbit orbit{entry.at("code"), number("period"), number("unstable_multiplier"), {}};
        orbit.point =
            lorenz ? Eigen::Vector3d(number("x"), number("y"), 27.0) : Eigen::Vector3d(0.0, number("y"), number("z"));
        table.orbits.push_back(orbit);
    }
    return table;
}

}  // namespace orbid::tests
