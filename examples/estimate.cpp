// Both parameters of the Henon map from the unstable cycles in a noisy record of its iterates.
#include <cstdio>
#include <string>

#include "estimator/estimate/estimate.hpp"
#include "models/catalogue/registry.hpp"
#include "orbits/cycle_residuals/cycle_residual.hpp"
#include "orbits/cycles/cycle_search.hpp"
#include "orbits/simulation/virtual_experiment.hpp"

using namespace orbid;

int main() {
    const auto henon = models::make_system("henon");
    const Eigen::VectorXd exact = henon->default_parameters();

    orbits::VirtualExperimentOptions experiment{.plan = orbits::SectionPlan{.sections = 20000}};
    experiment.initial = Eigen::Vector2d(0.1, 0.1);
    experiment.noise = Eigen::Vector2d(1e-4, 1e-4);
    const orbits::Series record = orbits::simulate(*henon, exact, experiment).series;

    const auto found = orbits::find_cycles(record, {.periods = {1, 2, 4, 6, 7}});
    const models::ParameterBinding binding{exact, {0, 1}, {0, 1}, 2};
    orbits::CycleResidual cycles(henon, binding, found.cycles, 0.0, Eigen::Vector2d(1.35, 0.28));

    const auto result = estimator::estimate({{.name = "a", .start = 1.35}, {.name = "b", .start = 0.28}}, {&cycles});
    std::printf("%s\n", estimator::name(result.status).data());
    for (const auto& parameter : result.parameters)
        std::printf("%s = %.3f\n", parameter.name.c_str(), parameter.value);
}
