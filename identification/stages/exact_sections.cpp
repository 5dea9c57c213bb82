#include "identification/stages/exact_sections.hpp"

#include <algorithm>
#include <string>
#include <utility>

#include <fmt/format.h>

#include "identification/problem/estimated_values.hpp"
#include "identification/stages/series_doubt.hpp"
#include "identification/stages/several_starts.hpp"
#include "orbits/records/data_error.hpp"

namespace orbid::identification {

namespace {

/// Whether sections alone are estimated whose matching is left to us, and all of them err much.
bool may_be_exact(const StageInput& input, const ProblemResiduals& residuals, const estimator::Estimate& estimate) {
    const auto& shooting = residuals.shooting;
    if (shooting.empty() || residuals.all().size() != shooting.size() || estimate.active.size() != shooting.size() ||
        input.problem.series->matching.kind != Matching::Kind::automatic)
        return false;
    bool any = false;
    for (std::size_t i = 0; i < shooting.size(); ++i) {
        const orbits::ShootingResidual& one = *shooting[i];
        any = any || one.matching().estimate;
        if (one.series().sampling == orbits::Series::Sampling::samples ||
            !(one.noise(estimate.active[i]) > orbits::noisy_readings))
            return false;
    }
    return any;
}

}  // namespace

std::optional<ExactSections> exact_sections(const StageInput& input,
                                            const std::vector<estimator::FreeParameter>& parameters,
                                            const ProblemResiduals& residuals, const estimator::Estimate& estimate,
                                            const estimator::EstimateOptions& options) {
    if (!may_be_exact(input, residuals, estimate)) return std::nullopt;
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
    const std::string doubt = series_doubt(*input.problem.system, run);
    input.observer.detail(doubt.empty() ? std::string("matched exactly, the sections are explained")
                                        : fmt::format("sections matched exactly: {}", doubt));
    if (!doubt.empty()) return std::nullopt;
    found.residuals = std::move(run.residuals);
    found.estimate = std::move(run.estimate);
    return found;
}

}  // namespace orbid::identification
