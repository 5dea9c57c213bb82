#pragma once

#include <span>

#include "models/system/system.hpp"

namespace orbid::models {

/// Wrong calls of a System: each function throws std::invalid_argument that names what, its value and the rule broken.
void check_parameters(const System& system, const Eigen::VectorXd& theta);
void check_state(const System& system, const Eigen::VectorXd& state);
void check_columns(const System& system, const Eigen::MatrixXd& states, std::span<const double> phases);
void check_free(const System& system, std::span<const Eigen::Index> free);
void check_options(const FlowOptions& options);
void check_sensor(const System& system, const Sensor& sensor);
void check_section(const System& system, const Section& section, double longest);
void check_flow(const System& system, const Eigen::VectorXd& x0, double phase, std::span<const double> durations,
                const Eigen::VectorXd& theta, std::span<const Eigen::Index> free, Clock clock,
                const FlowOptions& options);

}  // namespace orbid::models
