#include "identification/comparison/matching_check.hpp"

#include <cmath>
#include <limits>

#include <fmt/format.h>

#include "identification/problem/estimated_values.hpp"
#include "orbits/series_residuals/continuity_report.hpp"
#include "orbits/series_residuals/process_noise.hpp"

namespace orbid::identification {

namespace {

/// Sds of matching at the estimate, shape (n): as set, or as estimated.
Eigen::VectorXd matching_sds(const orbits::ShootingResidual& residual, const estimator::ActiveSet& active,
                             const estimator::Estimate& estimate) {
    if (residual.matching().constraints) return residual.matching_sd(active);
    Eigen::VectorXd scales(std::ssize(residual.groups()));
    for (Eigen::Index g = 0; g < scales.size(); ++g) {
        const auto* scale = scale_of(estimate, residual.groups()[static_cast<std::size_t>(g)].name);
        scales[g] = scale != nullptr ? scale->value : active.groups[static_cast<std::size_t>(g)].scale.value;
    }
    return residual.matching_sd(scales);
}

Eigen::VectorXd laplace_sds(const estimator::Estimate& estimate) {
    return column(estimate.parameters, &estimator::Estimated::laplace_sd);
}

/// Errors of the readings as estimated, by group; nan where they are given. Estimated anew they could tend to zero:
/// under loose matching the nodes may follow the readings of a coordinate.
std::vector<double> estimated_errors(const orbits::ShootingResidual& residual, const estimator::Estimate& estimate) {
    const auto& groups = residual.groups();
    std::vector<double> errors;
    for (std::size_t g = 0; g < residual.reading_groups(); ++g) {
        const auto* scale = groups[g].scale.estimate ? scale_of(estimate, groups[g].name) : nullptr;
        errors.push_back(scale != nullptr ? scale->value : std::numeric_limits<double>::quiet_NaN());
    }
    return errors;
}

/// The same estimate with looser matching, from its own nodes.
void compare_looser(const StageInput& input, const StageRun& run, std::vector<orbits::ContinuityReport>& reports) {
    const auto& shooting = run.residuals.shooting;
    std::vector<orbits::ShootingResidual> looser;
    looser.reserve(shooting.size());
    std::vector<const estimator::Residual*> residuals;
    for (std::size_t i = 0; i < shooting.size(); ++i) {
        looser.push_back(shooting[i]->with(orbits::looser(*shooting[i], run.estimate.active[i]), run.estimate.active[i],
                                           run.estimate.latents[i], estimated_theta(run.estimate),
                                           estimated_errors(*shooting[i], run.estimate)));
        residuals.push_back(&looser.back());
    }
    std::vector<estimator::FreeParameter> parameters = run.parameters;
    std::vector<std::string> names;
    for (std::size_t i = 0; i < parameters.size(); ++i) {
        parameters[i].start = run.estimate.parameters[i].value;
        names.push_back(parameters[i].name);
    }
    estimator::EstimateOptions options = input.estimate;
    options.verdict = false;
    options.progress = {};
    options.watched = [&input](const estimator::StepReport& report) {
        input.observer.step("ten times looser matching", report);
    };
    const auto other = estimator::estimate(parameters, residuals, {}, options);
    input.observer.detail(fmt::format("ten times looser matching: {}, {} iterations; {}", estimator::name(other.status),
                                      other.iterations, other.message));
    if (other.status != estimator::EstimateStatus::converged) return;
    for (std::size_t i = 0; i < shooting.size(); ++i)
        orbits::compare(reports[i], *shooting[i], run.estimate.active[i], names, estimated_theta(run.estimate),
                        laplace_sds(run.estimate), estimated_theta(other), laplace_sds(other));
}

/// Process noise as estimated: squares of scales.
std::vector<MatchingResult::Diffusion> diffusions(const IdentificationProblem& problem,
                                                  const orbits::ShootingResidual& residual,
                                                  const estimator::ActiveSet& active,
                                                  const estimator::Estimate& estimate) {
    std::vector<MatchingResult::Diffusion> result;
    std::size_t g = residual.reading_groups();
    for (const Eigen::Index i : residual.noisy_coordinates()) {
        const estimator::Group& group = active.groups[g++];
        const auto* scale = scale_of(estimate, group.name);
        if (scale == nullptr) continue;
        const auto coordinate = problem.system->coordinates()[static_cast<std::size_t>(i)];
        MatchingResult::Diffusion& one = result.emplace_back();
        one.name = coordinate.name;
        one.unit = orbits::diffusion_unit(coordinate.unit);
        one.least = group.floor * group.floor;
        one.lower95 = one.upper95 = std::numeric_limits<double>::quiet_NaN();
        if (!std::isfinite(scale->lower95)) continue;  // held at its least value
        one.value = scale->value * scale->value;
        one.sd = 2.0 * scale->value * scale->uncertainty;
        one.lower95 = scale->lower95 * scale->lower95;
        one.upper95 = scale->upper95 * scale->upper95;
        // A scale that may be zero has no interval in its logarithm: a one-sided limit, normal in the scale itself.
        constexpr double open_share = 0.5, normal95 = 1.6448536269514722;
        if (scale->uncertainty > open_share * scale->value) {
            one.lower95 = 0.0;
            one.upper95 = std::pow(scale->value + normal95 * scale->uncertainty, 2);
        }
    }
    return result;
}

}  // namespace

std::vector<MatchingResult> matching_results(const StageInput& input, const StageRun& run, bool compared) {
    const IdentificationProblem& problem = input.problem;
    const auto& shooting = run.residuals.shooting;
    const std::size_t first = run.residuals.first_shooting();
    if (shooting.empty() || run.estimate.latents.size() != run.residuals.all().size()) return {};
    std::vector<orbits::ContinuityReport> reports;
    bool diffusion = false;
    for (std::size_t i = 0; i < shooting.size(); ++i) {
        const estimator::ActiveSet& active = run.estimate.active[first + i];
        const bool own = shooting[i]->matching().kind == orbits::Continuity::Kind::diffusion;
        reports.push_back(orbits::matching_report(
            *shooting[i], active, estimated_theta(run.estimate), run.estimate.latents[first + i],
            own ? matching_sds(*shooting[i], active, run.estimate) : Eigen::VectorXd()));
        diffusion = diffusion || own;
    }
    const bool alone = run.residuals.all().size() == shooting.size();
    // Process noise is what the model misses: it has been asked for, and no other matching is right.
    if (compared && alone && !diffusion && run.estimate.status == estimator::EstimateStatus::converged)
        compare_looser(input, run, reports);
    std::vector<MatchingResult> results;
    const auto coordinates = problem.system->coordinates();
    for (std::size_t i = 0; i < shooting.size(); ++i) {
        const orbits::ContinuityReport& report = reports[i];
        MatchingResult& result = results.emplace_back();
        result.experiment = problem.experiments[run.residuals.shooting_experiments[i]].name;
        result.interval = static_cast<std::size_t>(shooting[i]->interval());
        result.intervals = report.defect.count;
        result.large = report.defect.large;
        result.expected = report.expected;
        result.warnings = report.warnings;
        result.diffusion = diffusions(problem, *shooting[i], run.estimate.active[first + i], run.estimate);
        const Eigen::VectorXd sds = matching_sds(*shooting[i], run.estimate.active[first + i], run.estimate);
        for (Eigen::Index c = 0; c < sds.size(); ++c) {
            const auto& coordinate = coordinates[static_cast<std::size_t>(c)];
            result.coordinates.push_back({std::string(coordinate.name), std::string(coordinate.unit), sds[c],
                                          report.defect.rms[c], report.defect.typical[c]});
        }
        for (Eigen::Index p = 0; p < report.shift.size(); ++p)
            result.shift.emplace_back(run.estimate.parameters[static_cast<std::size_t>(p)].name, report.shift[p]);
    }
    return results;
}

std::optional<double> matched_noise(const StageRun& run) {
    double sum = 0.0;
    const auto& shooting = run.residuals.shooting;
    const std::size_t first = run.residuals.first_shooting();
    for (std::size_t i = 0; i < shooting.size(); ++i)
        sum += std::log(shooting[i]->noise(run.estimate.active.at(first + i)));
    if (shooting.empty() || !std::isfinite(sum)) return std::nullopt;
    return std::exp(sum / static_cast<double>(shooting.size()));
}

SeriesStart estimated_nodes(const StageRun& run) {
    return nodes_at(run.residuals, run.estimate);
}

}  // namespace orbid::identification
