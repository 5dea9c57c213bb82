#include "identification/starts/cycle_start.hpp"

#include <algorithm>
#include <limits>
#include <string>
#include <utility>

#include <fmt/format.h>

#include "identification/problem/estimated_values.hpp"
#include "orbits/cycle_residuals/lifted_cycle_residual.hpp"
#include "orbits/cycle_residuals/one_period_residual.hpp"

namespace orbid::identification {

namespace {

// Where the plain way leads to wrong orbits: Student's t with 4 degrees of freedom, from a sixth of the range (1 rad),
// where an orbit holds nothing together.
const estimator::StudentErrors tails{{false, 4.0, estimator::FlatPrior{}}};
constexpr double homotopy_start = 0.16;
constexpr double homotopy_factor = 0.3;
constexpr double homotopy_end = 1e-4;
// Orbits lie this near to their measured points (rms, share of the range) for all but a few cycles, or the start is not
// good: points are measured better than that, and wrong parameters or wrong orbits lie 0.05 and more away.
constexpr double good_distance = 0.02;
constexpr double most_cycles = 0.8;
// A stage only has to come near its optimum: the next one moves it again.
constexpr int stage_iterations = 120;
constexpr double stage_tolerance = 1e-2;
// What has run to 0 on the way begins the estimate on a logarithmic scale at this share of its start.
constexpr double least_share = 1e-3;

/// Parameters as rough stages see them: what may be 0 moves on the linear scale, for on the logarithmic one there would
/// be no way back from a value that is too small. Not where a prior says something: its mode is another one on another
/// scale, and the estimate proper would begin away from its own.
std::vector<estimator::FreeParameter> for_stages(std::vector<estimator::FreeParameter> parameters,
                                                 const std::vector<estimator::JointNormalPrior>& joint_priors) {
    for (estimator::FreeParameter& parameter : parameters)
        if (parameter.scale != estimator::Scale::linear && parameter.lower <= 0.0 &&
            !estimator::is_proper(parameter.prior) && !in_joint_prior(joint_priors, parameter.name))
            parameter.scale = estimator::Scale::linear;
    return parameters;
}

void move_starts(std::vector<estimator::FreeParameter>& parameters, const estimator::Estimate& estimate) {
    for (std::size_t i = 0; i < parameters.size(); ++i)
        parameters[i].start = estimate.parameters[i].value;
}

/// Where stages ended.
struct Candidate {
    std::vector<estimator::FreeParameter> parameters;
    std::vector<Eigen::MatrixXd> nodes = {};
    double distance = std::numeric_limits<double>::infinity();
};

/// The way from one start to the next better one.
class FarStartSearch {
public:
    FarStartSearch(const CycleStartProblem& problem, const CycleStartOptions& options, CycleStart& count)
        : problem_(problem), options_(options), count_(count) {
        // On the way to a start normal errors will do: their form only matters for the final estimate.
        problem_.targets.forms.clear();
        problem_.targets.covariances.clear();
    }

    /// From now on other ways are tried: their steps are no longer the best so far.
    void try_others() { only_way_ = false; }

    [[nodiscard]] bool interrupted() const { return options_.estimate.interrupted && options_.estimate.interrupted(); }

    /// The parameters of the smallest misfit of one-period predictions on a ladder about the start.
    [[nodiscard]] std::vector<estimator::FreeParameter> scanned(
        std::vector<estimator::FreeParameter> parameters) const {
        const Eigen::VectorXd found = orbits::scanned_start(
            one_period(parameters), starts(parameters), column(parameters, &estimator::FreeParameter::lower),
            column(parameters, &estimator::FreeParameter::upper),
            column(parameters, &estimator::FreeParameter::typical_size));
        for (std::size_t i = 0; i < parameters.size(); ++i)
            parameters[i].start = found[static_cast<Eigen::Index>(i)];
        return parameters;
    }

    [[nodiscard]] std::vector<estimator::FreeParameter> predicted(std::vector<estimator::FreeParameter> parameters) {
        const orbits::OnePeriodResidual residual = one_period(parameters);
        const auto estimate = stage("one-period prediction", parameters, residual);
        if (estimate.status != estimator::EstimateStatus::failed) move_starts(parameters, estimate);
        return parameters;
    }

    /// Orbits and parameters together, the matching sd falling from the defect that the start leaves.
    [[nodiscard]] Candidate lifted(const std::vector<estimator::FreeParameter>& parameters) {
        orbits::LiftedCycleOptions options;
        options.points = tails;
        return lifted("lifted cycles", parameters, options);
    }

    /// The same with heavy tails in the matching too, from a matching sd at which next to nothing is held; then as
    /// above, for an orbit that was given up in between pulls no more.
    [[nodiscard]] Candidate homotopy(const std::vector<estimator::FreeParameter>& parameters) {
        orbits::LiftedCycleOptions options;
        options.points = tails;
        options.matching = tails;
        options.matching_start = homotopy_start;
        options.matching_factor = homotopy_factor;
        options.matching_end = homotopy_end;
        return lifted(lifted("lifted cycles with heavy tails", parameters, options).parameters);
    }

private:
    [[nodiscard]] orbits::OnePeriodResidual one_period(const std::vector<estimator::FreeParameter>& parameters) const {
        orbits::OnePeriodOptions options;
        options.targets = problem_.targets;
        return orbits::OnePeriodResidual(problem_.system, problem_.binding, problem_.cycles, problem_.place,
                                         starts(parameters), options);
    }

    [[nodiscard]] Candidate lifted(const std::string& name, const std::vector<estimator::FreeParameter>& parameters,
                                   orbits::LiftedCycleOptions options) {
        options.targets = problem_.targets;
        const orbits::LiftedCycleResidual residual(problem_.system, problem_.binding, problem_.cycles, problem_.place,
                                                   starts(parameters), options);
        const auto estimate = stage(name, parameters, residual);
        Candidate found{parameters};
        found.nodes = residual.nodes(residual.initial_set(), residual.initial_latents());
        if (estimate.status == estimator::EstimateStatus::failed || estimate.latents.empty()) return found;
        move_starts(found.parameters, estimate);
        const estimator::ActiveSet& active = estimate.active.front();
        found.nodes = residual.nodes(active, estimate.latents.front());
        if (!active.is_intermediate_stage)
            found.distance =
                typical_distance(residual.distances(active, starts(found.parameters), estimate.latents.front()));
        if (options_.log) options_.log(fmt::format("{}: orbits within {:.2e} of the points", name, found.distance));
        return found;
    }

    [[nodiscard]] estimator::Estimate stage(const std::string& name,
                                            const std::vector<estimator::FreeParameter>& parameters,
                                            const estimator::Residual& residual) {
        estimator::EstimateOptions options = options_.estimate;
        options.variance = estimator::Variance::ml;
        options.verdict = false;
        options.error_uncertainties = false;
        options.maximum_iterations = stage_iterations;
        options.step_tolerance = stage_tolerance;
        options.watched = nullptr;
        if (options_.watched)
            options.watched = [&](const estimator::StepReport& report) {
                options_.watched(name, report);
                if (only_way_ && options_.reached && report.phase == estimator::StepReport::Phase::minimisation)
                    options_.reached(report.theta);
            };
        const auto estimate = estimator::estimate(parameters, {&residual}, {}, options);
        count_.iterations += estimate.iterations;
        count_.evaluations += estimate.evaluations;
        if (options_.log)
            options_.log(fmt::format("{}: {}, {} iterations, objective {:.6g}; {}", name,
                                     estimator::name(estimate.status), estimate.iterations, estimate.objective,
                                     estimate.message));
        return estimate;
    }

    static double typical_distance(std::vector<double> distances) {
        if (distances.empty()) return std::numeric_limits<double>::infinity();
        const auto at =
            distances.begin() + static_cast<std::ptrdiff_t>(most_cycles * static_cast<double>(distances.size() - 1));
        std::nth_element(distances.begin(), at, distances.end());
        return *at;
    }

    CycleStartProblem problem_;
    const CycleStartOptions& options_;
    CycleStart& count_;
    bool only_way_ = true;
};

}  // namespace

CycleStart start_from_cycles(const CycleStartProblem& problem, const std::vector<estimator::FreeParameter>& parameters,
                             const CycleStartOptions& options) {
    CycleStart result;
    FarStartSearch approach(problem, options, result);
    const auto begin = for_stages(parameters, options.estimate.joint_priors);
    const auto predicted = approach.predicted(begin);
    Candidate best = approach.lifted(predicted);
    const auto found = [&] { return best.distance < good_distance || approach.interrupted(); };
    const auto take = [&](Candidate candidate) {
        if (!(candidate.distance < best.distance)) return;
        best = std::move(candidate);
        if (options.reached) options.reached(starts(best.parameters));
    };
    approach.try_others();
    if (options.reached) options.reached(starts(best.parameters));
    if (!found()) take(approach.homotopy(predicted));
    if (!found()) take(approach.homotopy(begin));
    if (!found() && options.scan) {
        const auto scanned = approach.predicted(approach.scanned(begin));
        take(approach.lifted(scanned));
        if (!found()) take(approach.homotopy(scanned));
    }
    result.theta = starts(best.parameters);
    for (std::size_t i = 0; i < parameters.size(); ++i) {
        double& value = result.theta[static_cast<Eigen::Index>(i)];
        if (parameters[i].scale != estimator::Scale::linear && !(value > parameters[i].lower))
            value = parameters[i].lower + least_share * (parameters[i].start - parameters[i].lower);
    }
    result.nodes = std::move(best.nodes);
    return result;
}

}  // namespace orbid::identification
