#include "apps/cycle_start.hpp"

#include <algorithm>

#include <fmt/format.h>

#include "orbits/lifted_cycle_residual.hpp"
#include "orbits/one_period_residual.hpp"
#include "orbits/start_scan.hpp"

namespace orbid::apps {

namespace {

// The matching sd starts at the defect that the one-period prediction leaves, and falls by this factor per stage: the
// schedule with which the wide starts of tests/orbits/cycle_estimation_test.cpp were tried.
constexpr double matching_factor = 0.1;
// It ends at this share of the range: small against any point error, so that the nodes are orbits to all purposes, and
// large against the error of the flow (1e-11).
constexpr double final_matching = 1e-8;
// A stage only has to come near its optimum: the next one moves it again.
constexpr int stage_iterations = 60;
constexpr double stage_tolerance = 1e-2;

void move_starts(std::vector<estimator::FreeParameter>& parameters, const estimator::Estimate& estimate) {
    for (std::size_t i = 0; i < parameters.size(); ++i)
        parameters[i].start = estimate.parameters[i].value;
}

/// One field of all parameters.
Eigen::VectorXd column(const std::vector<estimator::FreeParameter>& parameters,
                       double estimator::FreeParameter::*field) {
    Eigen::VectorXd values(static_cast<Eigen::Index>(parameters.size()));
    for (std::size_t i = 0; i < parameters.size(); ++i)
        values[static_cast<Eigen::Index>(i)] = parameters[i].*field;
    return values;
}

Eigen::VectorXd starts(const std::vector<estimator::FreeParameter>& parameters) {
    return column(parameters, &estimator::FreeParameter::start);
}

}  // namespace

CycleStart start_from_cycles(const CycleStartProblem& problem, const std::vector<estimator::FreeParameter>& parameters,
                             const CycleStartOptions& options) {
    // On the way to a start normal errors will do: their form only matters for the final estimate.
    orbits::CycleTargetOptions targets = problem.targets;
    targets.forms.clear();
    targets.covariances.clear();
    std::vector<estimator::FreeParameter> current = parameters;
    CycleStart result;
    const auto stage = [&](std::string_view name, estimator::Residual& residual) {
        estimator::EstimateOptions stage_options = options.estimate;
        stage_options.variance = estimator::Variance::ml;
        stage_options.verdict = false;
        stage_options.maximum_iterations = stage_iterations;
        stage_options.step_tolerance = stage_tolerance;
        const auto estimate = estimator::estimate(current, {&residual}, {}, stage_options);
        result.iterations += estimate.iterations;
        result.evaluations += estimate.evaluations;
        if (options.log)
            options.log(fmt::format("{}: {}, {} iterations, objective {:.6g}; {}", name,
                                    estimator::name(estimate.status), estimate.iterations, estimate.objective,
                                    estimate.message));
        return estimate;
    };

    orbits::OnePeriodOptions one_period_options;
    one_period_options.targets = targets;
    const auto one_period_at = [&](const Eigen::VectorXd& theta) {
        return orbits::OnePeriodResidual(problem.system, problem.binding, problem.cycles, problem.phase, theta,
                                         one_period_options);
    };
    if (options.scan) {
        const Eigen::VectorXd scanned = orbits::scanned_start(one_period_at(starts(current)), starts(current),
                                                              column(current, &estimator::FreeParameter::lower),
                                                              column(current, &estimator::FreeParameter::upper),
                                                              column(current, &estimator::FreeParameter::typical_size));
        for (std::size_t i = 0; i < current.size(); ++i)
            current[i].start = scanned[static_cast<Eigen::Index>(i)];
    }
    orbits::OnePeriodResidual one_period = one_period_at(starts(current));
    const auto first = stage("one-period prediction", one_period);
    if (first.status != estimator::EstimateStatus::failed) move_starts(current, first);

    orbits::LiftedCycleOptions lifted_options;
    lifted_options.targets = targets;
    const Eigen::VectorXd scale = orbits::target_scale(*problem.system, problem.cycles);
    orbits::LiftedCycleResidual lifted(problem.system, problem.binding, problem.cycles, problem.phase, starts(current),
                                       scale, lifted_options);
    std::vector<Eigen::VectorXd> latents = lifted.initial_latents();
    // Relative to the range, so that one number serves all coordinates.
    double matching = (lifted.matching_defect(starts(current), latents).array() / scale.array()).maxCoeff();
    matching = std::max(matching, final_matching);
    while (true) {
        if (options.estimate.interrupted && options.estimate.interrupted()) break;
        auto tightened = lifted.tightened(matching * scale, latents);
        const auto estimate = stage(fmt::format("lifted cycles, matching sd {:.1e} of the range", matching), tightened);
        if (estimate.status == estimator::EstimateStatus::failed) break;
        move_starts(current, estimate);
        latents = estimate.latents.front();
        if (matching <= final_matching) break;
        matching = std::max(matching * matching_factor, final_matching);
    }
    result.theta = starts(current);
    result.nodes = lifted.nodes(latents);
    return result;
}

CycleStart start_from_cycles(const Workspace& work, const std::vector<estimator::FreeParameter>& parameters,
                             const models::ParameterBinding& binding, const std::vector<orbits::Cycle>& cycles,
                             const orbits::CycleTargetOptions& targets, const estimator::EstimateOptions& options) {
    CycleStartOptions start_options;
    start_options.estimate = options;
    start_options.log = [&](const std::string& line) { work.progress.log(line); };
    return start_from_cycles({work.job.model.system, binding, cycles, work.job.section_phase, targets}, parameters,
                             start_options);
}

}  // namespace orbid::apps
