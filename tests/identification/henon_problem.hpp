#pragma once

#include <cstddef>
#include <memory>

#include <Eigen/Core>

#include "identification/problem/identification_problem.hpp"
#include "models/catalogue/registry.hpp"
#include "orbits/simulation/virtual_experiment.hpp"

namespace orbid::tests {

/// Iterates of the Henon map (a = 1.4, b = 0.3) in two segments; both parameters start off by 10 %.
/// @param noise  sds of the errors of x and y.
inline identification::IdentificationProblem henon_problem(std::size_t iterates = 800,
                                                           const Eigen::Vector2d& noise = {1e-3, 1e-3}) {
    identification::IdentificationProblem problem;
    problem.system = models::make_system("henon");
    orbits::VirtualExperimentOptions experiment;
    experiment.plan = orbits::SectionPlan{iterates, 100, {}, 0.0};
    experiment.trajectories = 2;
    experiment.initial = Eigen::MatrixXd{{0.1, 0.2}, {0.1, 0.1}};
    experiment.noise = noise;
    experiment.seed = 3;
    problem.experiments.emplace_back();
    problem.experiments.back().name = "run1";
    problem.experiments.back().series = std::make_shared<const orbits::Series>(
        orbits::simulate(*problem.system, Eigen::Vector2d(1.4, 0.3), experiment).series);
    problem.experiments.back().follows_model = true;
    problem.parameters = {identification::free_parameter(*problem.system, "a", 1.54),
                          identification::free_parameter(*problem.system, "b", 0.27)};
    return problem;
}

}  // namespace orbid::tests
