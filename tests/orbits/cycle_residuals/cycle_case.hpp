#pragma once

#include <algorithm>
#include <memory>
#include <string>
#include <vector>

#include "estimator/estimate/estimate.hpp"
#include "models/catalogue/registry.hpp"
#include "orbits/cycle_residuals/cycle_residual.hpp"
#include "orbits/cycle_residuals/lifted_cycle_residual.hpp"
#include "orbits/cycle_residuals/one_period_residual.hpp"
#include "tests/orbits/cycles/measured_cycles.hpp"

namespace orbid::tests {

/// One estimated parameter of the reference pendulum (g = 9.81), started at a multiple of the truth.
struct StartFactor {
    std::string name;
    double factor;
    bool linear = false;  ///< scale of the coordinate
};

struct CycleCase {
    std::shared_ptr<const models::System> system = models::make_system("parametric_pendulum");
    ReferenceOrbits table = read_reference_orbits(*system, "pendulum_orbits_g9.81.json");
    std::vector<estimator::FreeParameter> parameters;
    models::ParameterBinding binding;

    explicit CycleCase(const std::vector<StartFactor>& starts) {
        binding.base = table.theta;
        for (const StartFactor& start : starts) {
            const Eigen::Index index = system->parameter_index(start.name);
            estimator::FreeParameter parameter;
            parameter.name = start.name;
            parameter.start = start.factor * table.theta(index);
            parameter.scale = start.linear ? estimator::Scale::linear : estimator::Scale::log;
            parameter.lower = 0.0;
            parameter.typical_size = system->parameters()[static_cast<std::size_t>(index)].typical_size;
            binding.estimated.push_back(static_cast<Eigen::Index>(parameters.size()));
            binding.parameter.push_back(index);
            parameters.push_back(parameter);
        }
        binding.estimated_count = static_cast<Eigen::Index>(parameters.size());
    }

    [[nodiscard]] Eigen::VectorXd truth() const {
        Eigen::VectorXd theta(binding.estimated_count);
        for (Eigen::Index i = 0; i < theta.size(); ++i)
            theta(i) = table.theta(binding.parameter[static_cast<std::size_t>(i)]);
        return theta;
    }
};

inline Eigen::VectorXd starts(const std::vector<estimator::FreeParameter>& parameters) {
    Eigen::VectorXd theta(static_cast<Eigen::Index>(parameters.size()));
    for (std::size_t i = 0; i < parameters.size(); ++i)
        theta(static_cast<Eigen::Index>(i)) = parameters[i].start;
    return theta;
}

/// All stages: ladder, one-period prediction, lifted cycles with a falling matching sd, re-solved orbits.
inline estimator::Estimate estimate_from_cycles(const CycleCase& c, const std::vector<orbits::Cycle>& cycles) {
    auto parameters = c.parameters;
    const auto move_to = [&](const Eigen::VectorXd& theta) {
        for (std::size_t i = 0; i < parameters.size(); ++i)
            parameters[i].start = theta(static_cast<Eigen::Index>(i));
    };
    const auto estimated = [&](const estimator::Estimate& estimate) {
        Eigen::VectorXd theta(static_cast<Eigen::Index>(parameters.size()));
        for (std::size_t i = 0; i < parameters.size(); ++i)
            theta(static_cast<Eigen::Index>(i)) = estimate.parameters[i].value;
        return theta;
    };
    Eigen::VectorXd lower(c.binding.estimated_count);
    Eigen::VectorXd upper(c.binding.estimated_count);
    Eigen::VectorXd size(c.binding.estimated_count);
    for (Eigen::Index i = 0; i < lower.size(); ++i) {
        const estimator::FreeParameter& parameter = parameters[static_cast<std::size_t>(i)];
        lower(i) = parameter.lower;
        upper(i) = parameter.upper;
        size(i) = parameter.typical_size;
    }
    estimator::EstimateOptions rough;
    rough.variance = estimator::Variance::ml;
    rough.maximum_iterations = 60;
    rough.step_tolerance = 1e-2;

    const orbits::OnePeriodResidual scan(c.system, c.binding, cycles, 0.0, starts(parameters));
    move_to(orbits::scanned_start(scan, starts(parameters), lower, upper, size));
    orbits::OnePeriodResidual one_period(c.system, c.binding, cycles, 0.0, starts(parameters));
    move_to(estimated(estimator::estimate(parameters, {&one_period}, {}, rough)));

    orbits::LiftedCycleOptions tails;
    tails.points = estimator::StudentErrors{};
    orbits::LiftedCycleResidual lifted(c.system, c.binding, cycles, 0.0, starts(parameters), tails);
    const auto stages = estimator::estimate(parameters, {&lifted}, {}, rough);
    move_to(estimated(stages));
    orbits::CycleResidual reduced(c.system, c.binding, cycles, 0.0, starts(parameters),
                                  lifted.nodes(stages.active.front(), stages.latents.front()));
    return estimator::estimate(parameters, {&reduced});
}

}  // namespace orbid::tests
