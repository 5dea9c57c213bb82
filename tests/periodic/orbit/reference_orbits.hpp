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

/// One cycle of tests/reference/pendulum_orbits_*.json: made in extended precision by an independent program, positions
/// to 1e-12, unstable multipliers to 12 digits, stable ones to 7.
struct ReferenceOrbit {
    int period = 0;
    int rotation = 0;
    bool mirror_symmetric = false;
    double unstable_multiplier = 0.0;
    double stable_multiplier = 0.0;
    Eigen::MatrixXd points;  ///< shape (2, p)
};

struct ReferenceOrbits {
    Eigen::VectorXd theta;  ///< shape (q), in the order of the system
    std::vector<ReferenceOrbit> orbits;
};

/// @param file  "pendulum_orbits_g9.81.json" or its sister.
inline ReferenceOrbits read_reference_orbits(const models::System& pendulum, const std::string& file) {
    const std::string path = orbid::tests::source_folder() + "/tests/reference/" + file;
    std::ifstream stream(path);
    if (!stream) throw std::runtime_error("cannot read " + path);
    const auto json = nlohmann::json::parse(stream);
    ReferenceOrbits table;
    table.theta = pendulum.default_parameters();
    for (const auto& [key, value] : json.at("parameters").items()) {
        const Eigen::Index index = pendulum.parameter_index(key);
        if (index < 0) throw std::runtime_error("no parameter " + key);
        table.theta(index) = value.get<double>();
    }
    for (const auto& entry : json.at("cycles")) {
        ReferenceOrbit orbit;
        orbit.period = entry.at("period").get<int>();
        orbit.rotation = entry.at("rotation").get<int>();
        orbit.mirror_symmetric = entry.at("mirror_symmetric").get<bool>();
        orbit.unstable_multiplier = entry.at("unstable_multiplier").get<double>();
        orbit.stable_multiplier = entry.at("stable_multiplier").get<double>();
        orbit.points.resize(2, orbit.period);
        for (int j = 0; j < orbit.period; ++j)
            for (int i = 0; i < 2; ++i)
                orbit.points(i, j) = entry.at("points").at(static_cast<std::size_t>(j)).at(static_cast<std::size_t>(i));
        table.orbits.push_back(orbit);
    }
    return table;
}

}  // namespace orbid::tests
