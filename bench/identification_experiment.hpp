#pragma once

#include <memory>
#include <string>
#include <vector>

#include "bench/ceres_shooting.hpp"
#include "estimator/estimate/estimate.hpp"
#include "models/system/system.hpp"
#include "orbits/records/series.hpp"

namespace orbid::bench {

/// A recorded series, what made it, and what is unknown about it.
struct Experiment {
    std::shared_ptr<const models::System> system;
    models::ParameterBinding binding;
    std::vector<estimator::FreeParameter> parameters;
    Eigen::VectorXd truth;  ///< of these
    orbits::Series series;
    models::Sensor sensor;
};

/// Adds an unknown of the system.
void free_parameter(Experiment& experiment, const std::string& name, double start, double lower);

/// Lorenz' equations, all states read every 0.01 s for 30 s with noise 0.5; far start.
[[nodiscard]] Experiment lorenz_experiment();

/// The case of DiffEqParamEstim's benchmarks (SciML): the same equations for 3 s, exact, from 10 to 30 % off.
[[nodiscard]] Experiment short_lorenz_experiment();

/// The parametric pendulum with dry friction, sections read by an encoder now and 15.08 ms later.
[[nodiscard]] Experiment pendulum_experiment(std::size_t sections);

[[nodiscard]] Eigen::VectorXd start_of(const Experiment& experiment);

/// Threads that both sides may use.
[[nodiscard]] int threads();

/// The series cut into intervals of so many samples for Ceres, nodes from the readings.
/// @param most  samples of each segment that count
[[nodiscard]] ShootingTask shooting_task(const Experiment& experiment, Eigen::Index interval, Eigen::Index most);

/// Prints what an iteration on so many sections costs, and a flow.
void compare_iterations(std::size_t sections);

}  // namespace orbid::bench
