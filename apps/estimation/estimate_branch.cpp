#include "apps/estimation/estimate_branch.hpp"

#include <algorithm>
#include <complex>

#include "apps/drawing/branch_plot.hpp"
#include "apps/drawing/chart_picture.hpp"
#include "apps/job/estimate_job.hpp"
#include "apps/job/periodic_job.hpp"
#include "apps/results/branch_file.hpp"
#include "apps/stages/branch_stage.hpp"
#include "apps/stages/orbits_stage.hpp"
#include "estimator/interface/not_finite.hpp"
#include "identification/problem/fitted_branch.hpp"

namespace orbid::apps {

namespace {

int unstable_count(const periodic::PeriodicOrbit& orbit) {
    return static_cast<int>(std::count_if(orbit.multipliers.begin(), orbit.multipliers.end(),
                                          [](const auto& multiplier) { return std::abs(multiplier) > 1.0; }));
}

/// What was measured of every motion, beside the model where it has an orbit for it.
std::vector<MeasuredMotion> measured_motions(const periodic::BranchResidual& residual, Eigen::Index parameter,
                                             const std::vector<ResidualRow>& rows, const ResultContext& context) {
    std::vector<MeasuredMotion> motions;
    for (std::size_t b = 0; b < residual.orbits().size(); ++b) {
        const periodic::MeasuredOrbit& orbit = residual.orbits()[b];
        MeasuredMotion& motion = motions.emplace_back();
        motion.label = orbit.label;
        motion.parameter = orbit.binding.base[parameter];
        for (const std::size_t c : residual.sources(b)) {
            const auto [name, unit] = residual.quantity(residual.channels()[c]);
            motion.values.push_back(
                {name, unit, orbit.values[static_cast<Eigen::Index>(c)], estimator::nan_value, estimator::nan_value});
        }
    }
    // Rows and steady states of this residual are in the order of its motions; those without an orbit have no rows.
    auto row = rows.begin();
    const auto at = static_cast<std::size_t>(parameter);
    const auto first = static_cast<std::ptrdiff_t>(context.steady_states.size() - motions.size());
    for (std::size_t b = 0; b < motions.size(); ++b) {
        const SteadyState& state = context.steady_states[static_cast<std::size_t>(first) + b];
        motions[b].used = state.used;
        if (state.orbit.status == periodic::OrbitStatus::converged) motions[b].unstable = unstable_count(state.orbit);
        // Two motions may have one label: a lost one has no rows, whatever the next ones say.
        if (!state.used) continue;
        for (MeasuredMotion::Value& one : motions[b].values) {
            if (row == rows.end() || row->block != motions[b].label || row->coordinate != one.name) break;
            one.predicted = row->predicted;
            one.sd = row->sd;
            ++row;
        }
        // Rows of the parameter itself, where its measured value has errors.
        while (row != rows.end() && row->coordinate == residual.system().parameters()[at].name)
            ++row;
    }
    return motions;
}

}  // namespace

void store_fitted_branch(const Workspace& work, const identification::IdentificationProblem& problem,
                         const identification::EstimateSetup& setup, const periodic::BranchResidual& residual,
                         const estimator::ActiveSet& active, const Eigen::VectorXd& theta,
                         const std::vector<ResidualRow>& rows, const ResultContext& context) {
    const Job& job = work.job;
    FollowedBranches followed;
    for (auto& piece : identification::fitted_branch(problem, setup, residual, active, theta)) {
        followed.branches.push_back(std::move(piece.branch));
        followed.pieces.push_back(std::move(piece.from));
    }
    thin_out(job, followed.branches);
    for (const periodic::OrbitReading& reading : problem.branch->readings)
        followed.readings.push_back({reading.name, reading.unit, false});
    followed.measured = measured_motions(residual, problem.branch->parameter, rows, context);
    if (followed.branches.empty()) followed.message = "no branch begins at the given orbit, nor at a measured motion";
    double lower = problem.branch->at.minCoeff();
    double upper = problem.branch->at.maxCoeff();
    for (const periodic::Branch& branch : followed.branches)
        for (const periodic::BranchPoint& point : branch.points) {
            lower = std::min(lower, point.parameter);
            upper = std::max(upper, point.parameter);
        }
    const bool own_branch = job.periodic && job.periodic->continuation;
    const std::string name = own_branch ? "estimate_branch" : "branch";
    const models::Parameter& parameter = job.model.parameter(problem.branch->parameter);
    CycleFileHead head = cycle_file_head(job, context.fingerprint);
    head.coordinates = series_coordinates(work.system());
    work.folder.store(name + ".json", branches_text(head, parameter, lower, upper, followed));
    if (followed.branches.empty()) return;
    work.folder.store(name + ".csv", branches_csv(head, parameter, followed));
    const orbits::SeriesCoordinate across{std::string(parameter.name), std::string(parameter.unit), false};
    const std::string title = job.title.empty() ? "Measured motions and the fitted branch" : job.title;
    work.folder.store(name + ".svg",
                      chart_svg(measure_chart(followed, across, head.coordinates), title, run_picture_style));
}

}  // namespace orbid::apps
