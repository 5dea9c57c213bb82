#include "identification/stages/exact_sections.hpp"

#include <algorithm>
#include <cstddef>
#include <string>
#include <utility>

#include <fmt/format.h>

#include "identification/problem/estimated_values.hpp"
#include "identification/stages/series_doubt.hpp"
#include "identification/stages/several_starts.hpp"
#include "orbits/records/data_error.hpp"

namespace orbid::identification {

bool may_match_exactly(const StageInput& input, const ProblemResiduals& residuals) {
    const auto& shooting = residuals.shooting;
    if (shooting.empty() || residuals.all().size() != shooting.size() ||
        input.problem.series->matching.kind != Matching::Kind::automatic)
        return false;
    const auto sampled = [](const auto& one) { return one->series().sampling == orbits::Series::Sampling::samples; };
    const auto estimated = [](const auto& one) { return one->matching().estimate; };
    return std::none_of(shooting.begin(), shooting.end(), sampled) &&
           std::any_of(shooting.begin(), shooting.end(), estimated);
}

std::optional<ExactSections> exact_sections(const StageInput& input,
                                            const std::vector<estimator::FreeParameter>& parameters,
                                            const ProblemResiduals& residuals, const estimator::Estimate& estimate,
                                            const estimator::EstimateOptions& options) {
    if (estimate.active.size() != residuals.shooting.size()) return std::nullopt;
    for (std::size_t i = 0; i < residuals.shooting.size(); ++i)
        if (!(residuals.shooting[i]->noise(estimate.active[i]) > orbits::noisy_readings)) return std::nullopt;
    ExactSections found;
    found.start.theta = estimated_theta(estimate);
    found.start.follows = true;
    found.start.attempts = 1;
    found.start.iterations = estimate.iterations;
    found.start.evaluations = estimate.evaluations;
    std::vector<estimator::FreeParameter> begun = parameters;
    for (std::size_t i = 0; i < begun.size(); ++i)
        if (begun[i].tied_to.empty()) begun[i].start = estimate.parameters[i].value;
    try {
        add_shooting(input.problem, input.setup, found.start, found.residuals);
    } catch (const orbits::DataError&) {  // no states at these parameters
        return std::nullopt;
    }
    StageRun run;
    run.residuals = std::move(found.residuals);
    run.estimate = affordable_estimate(input, found.start, begun, run.residuals, options);
    if (run.estimate.status == estimator::EstimateStatus::interrupted) return std::nullopt;
    const std::string doubt = series_doubt(*input.problem.system, run);
    if (!doubt.empty()) {
        input.observer.detail(fmt::format("sections matched exactly: {}", doubt));
        return std::nullopt;
    }
    input.observer.remark(
        "nodes are matched exactly: errors of readings alone explain the sections; say \"matching\": {\"sd\": "
        "\"estimate\"} if the model may be wrong by less than they show");
    found.residuals = std::move(run.residuals);
    found.estimate = std::move(run.estimate);
    return found;
}

}  // namespace orbid::identification
