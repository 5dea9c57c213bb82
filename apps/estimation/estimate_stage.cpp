#include "apps/estimation/estimate_stage.hpp"

#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include "apps/estimation/best_so_far.hpp"
#include "apps/estimation/checkpoint_fields.hpp"
#include "apps/estimation/estimate_branch.hpp"
#include "apps/estimation/estimate_records.hpp"
#include "apps/estimation/estimate_waveform.hpp"
#include "apps/estimation/job_problem.hpp"
#include "apps/estimation/posterior_stage.hpp"
#include "apps/estimation/step_outlook.hpp"
#include "apps/job/data_job.hpp"
#include "apps/job/estimate_job.hpp"
#include "apps/job/flow_stepper.hpp"
#include "apps/job/periodic_job.hpp"
#include "apps/results/checkpoint.hpp"
#include "apps/results/cycle_file.hpp"
#include "apps/results/orbit_file.hpp"
#include "apps/results/trust_verdict.hpp"
#include "apps/stages/orbits_stage.hpp"
#include "apps/stages/workspace.hpp"
#include "identification/comparison/residual_diagnosis.hpp"
#include "identification/problem/estimated_values.hpp"
#include "identification/problem/problem_residuals.hpp"
#include "identification/stages/strategy_stage.hpp"
#include "identification/strategy/identify.hpp"
#include "orbits/cycle_residuals/cycle_residual.hpp"

namespace orbid::apps {

using identification::estimate_options;
using identification::estimated_theta;
using identification::EstimateSetup;
using identification::IdentificationProblem;
using identification::IdentificationResult;
using identification::ProblemResiduals;
using identification::StageRun;
using identification::StageValue;

namespace {

void count_cycles(const orbits::CycleSearch& search, ResultContext& context) {
    context.orbits_found.clear();
    for (const orbits::Cycle& cycle : search.cycles)
        ++context.orbits_found[cycle.period];
}

void describe_data(const Workspace& work, const std::vector<Experiment>& data, const orbits::CycleSearch& search,
                   ResultContext& context) {
    for (const ReferenceJob& reference : work.job.reference)
        context.reference[reference.name] = reference.value;
    if (work.job.model.equations) context.evaluated = work.job.model.compiled ? "compiled" : "interpreted";
    for (const Experiment& experiment : data) {
        context.data_points += experiment.points();
        context.data_segments += experiment.segments();
        context.captured.insert(context.captured.end(), experiment.captured.begin(), experiment.captured.end());
    }
    count_cycles(search, context);
    context.orbits_missing = search.missing;
    context.fingerprint =
        stage_fingerprint(work.document, {"/model", "/seed", "/section", "/flow", "/data", "/orbits", "/estimate"});
}

/// Stores the orbits that belong to the measured cycles at the estimate.
void store_orbits(const Workspace& work, const orbits::CycleResidual& residual, const estimator::ActiveSet& active,
                  const orbits::CycleSearch& search, const models::ParameterBinding& binding,
                  const Eigen::VectorXd& theta, const IdentificationProblem& problem, const Fingerprint& fingerprint) {
    std::vector<std::string> names;
    for (const Eigen::Index parameter : binding.parameter)
        names.emplace_back(work.job.model.parameter(parameter).name);
    ComputedOrbits orbits;
    const auto found = residual.orbits(active, theta);
    for (std::size_t b = 0; b < found.size(); ++b) {
        ComputedOrbit& computed = orbits.list.emplace_back();
        computed.orbit = found[b];
        computed.origin = "cycle";
        computed.message = orbit_message(found[b]);
        if (computed.converged() && !active.layout[b].active)
            computed.message = "the model has this orbit at the estimate, but the estimate does not use it";
        // Nodes of a mesh that did not converge are no points of the section.
        if (computed.orbit.points.cols() != computed.orbit.period) computed.orbit.points.resize(0, 0);
        show_start(computed.orbit, residual.states(search.cycles[residual.cycle_of(b)].points));
    }
    // The stage "periodic" of the same job has orbits of its own.
    const std::string name = work.job.periodic ? "estimate_orbits.json" : "orbits.json";
    CycleFileHead head = cycle_file_head(work.job, fingerprint);
    head.coordinates = series_coordinates(work.system());  // also the one that is the same at all points of the section
    if (const auto& plane = problem.measured.plane) {
        Eigen::Index normal = 0;
        plane->normal.cwiseAbs().maxCoeff(&normal);
        head.plane = SectionPlane{std::string(work.job.model.coordinate(normal).name),
                                  plane->offset / plane->normal[normal], plane->direction};
    }
    work.folder.store(name, orbits_text(head, orbits, names));
}

/// Rows of residuals.csv, and what result.json says segment by segment; stores orbits and plots.
std::vector<ResidualRow> describe_records(const Workspace& work, const IdentificationProblem& problem,
                                          const EstimateSetup& setup, const orbits::CycleSearch& search,
                                          const StageRun& run, ResultContext& context) {
    const Job& job = work.job;
    const estimator::Estimate& estimate = run.estimate;
    const ProblemResiduals& residuals = run.residuals;
    std::vector<ResidualRow> rows;
    std::vector<ResidualRow> predicted;
    if (!run.is_evaluated()) return rows;
    const Eigen::VectorXd theta = estimated_theta(estimate);
    const auto sds = [&](std::size_t index) {
        return index < estimate.latent_sds.size() ? estimate.latent_sds[index] : std::vector<Eigen::VectorXd>{};
    };
    std::size_t index = 0;
    if (residuals.cycles) {
        const estimator::ActiveSet& active = estimate.active[index];
        add_cycle_rows(work, *residuals.cycles, active, search, estimate, estimate.residuals[index++], rows);
        if (!job.periodic)
            store_orbits(work, *residuals.cycles, active, search, identification::searched_binding(problem, setup),
                         theta, problem, context.fingerprint);
    }
    for (std::size_t i = 0; i < residuals.series.size(); ++i, ++index) {
        const std::size_t experiment = residuals.experiments[i];
        add_series_rows(work, experiment, *residuals.series[i], estimate, estimate.residuals[index], rows);
        add_initial_states(job, experiment, *residuals.series[i], estimate, setup.initial[experiment],
                           estimate.latents[index], sds(index), context);
        add_predictions(problem, experiment, *residuals.series[i], estimate, theta, true, context, predicted);
    }
    for (std::size_t i = 0; i < residuals.shooting.size(); ++i, ++index) {
        const std::size_t experiment = residuals.shooting_experiments[i];
        add_shooting_rows(work, experiment, *residuals.shooting[i], estimate, estimate.residuals[index], rows);
        add_first_nodes(job, experiment, *residuals.shooting[i], estimate.latents[index], sds(index), context);
        const bool samples = job.data[experiment].sampling() == orbits::Series::Sampling::samples;
        if (job.data[experiment].predict.empty() || !samples) continue;
        // Segments that took no part: single shooting over each.
        const auto single = identification::single_shooting(problem, experiment, setup);
        add_predictions(problem, experiment, *single, estimate, theta, false, context, predicted);
    }
    if (residuals.waveform.residual) {
        add_waveform_rows(job, residuals.waveform, estimate, estimate.residuals[index], rows);
        const estimator::ActiveSet& active = estimate.active[index];
        add_steady_states(job, residuals.waveform, active, theta, estimate.latents[index], sds(index), context);
        for (const auto& plot : waveform_plots(job, residuals.waveform, active, theta, estimate.latents[index]))
            work.folder.store(plot.first, plot.second);
        ++index;
    }
    if (residuals.branch) {
        std::vector<ResidualRow> own;
        add_branch_rows(work, *residuals.branch, estimate, estimate.residuals[index], own);
        add_branch_states(*residuals.branch, estimate.active[index], theta, context);
        store_fitted_branch(work, problem, setup, *residuals.branch, estimate.active[index], theta, own, context);
        rows.insert(rows.end(), own.begin(), own.end());
    }
    if (!predicted.empty()) work.folder.store("predictions.csv", residuals_text(predicted, work.asking()));
    return rows;
}

/// Shows an identification, and stores in the job's folder what it has come to.
class JobObserver final : public identification::Observer {
public:
    JobObserver(const Workspace& work, const IdentificationProblem& problem, EstimateOutcome& outcome)
        : work_(work),
          problem_(problem),
          outcome_(outcome),
          checkpoint_(work.folder, outcome.context.fingerprint),
          setup_(estimate_setup(problem, identification::fitted_labels(problem))),
          best_(work, setup_.parameters, outcome.context),
          outlook_(identification_options(work.job).step_tolerance) {}

    [[nodiscard]] Checkpoint& checkpoint() { return checkpoint_; }
    [[nodiscard]] const EstimateSetup& setup() const { return setup_; }

    [[nodiscard]] bool stopped() const override { return work_.interruption.asked(); }
    [[nodiscard]] bool left() const override { return asking_(); }
    void unstoppable(bool begins) override {
        leaving_.reset();
        if (begins) leaving_.emplace(work_.stop);
    }
    void begin(const std::string& step, double total, const std::string& unit) override {
        work_.progress.begin(step, total, unit);
    }
    void at(double done, const std::string& note) override { work_.progress.at(done, note); }
    void end(const std::string& outcome) override { work_.progress.end(outcome); }
    void within(const std::string& work) override { work_.progress.within(work); }
    void step(const std::string& minimisation, const estimator::StepReport& report) override {
        const StepOutlook::State state = outlook_.after(minimisation, report);
        work_.progress.note(state.words, state.remaining_s);
    }
    void reached(const Eigen::VectorXd& theta, double objective) override { best_.reached(theta, objective); }
    void recalled(const std::string& step, const std::string& outcome) override {
        work_.progress.reused(step, outcome + ", from checkpoint.bin");
    }
    void remark(const std::string& line) override { work_.progress.say(line); }
    void detail(const std::string& line) override { work_.progress.log(line); }

    void found(const orbits::CycleSearch& all) override {
        cycles_ = all;
        work_.folder.store("harvested_cycles.json",
                           cycles_text({cycle_file_head(work_.job, outcome_.context.fingerprint), all}));
    }
    void stage_ended(const IdentificationResult& so_far) override {
        const bool staged = work_.job.estimate->strategy.size() > 1;
        ResultContext& context = outcome_.context;
        context.structure = so_far.structure;
        if (staged) context.strategy.stages = so_far.stages;
        context.posterior.optima = so_far.optima;
        context.posterior.runs = so_far.runs;
        const estimator::Estimate& estimate = so_far.estimate;
        // A stage that was skipped or failed has nothing better than what was reached.
        if (!estimate.parameters.empty() && estimate.status != estimator::EstimateStatus::failed) {
            best_.finish();
            work_.stop.shows(interrupted_result(estimate, context));
        }
        if (staged) work_.folder.store("result.json", result_text(so_far.estimate, context));
    }
    /// What the best stage says beyond its estimate, stored before what may take long, and again with it.
    void estimated(const IdentificationResult& result) override {
        const StageRun& best = *result.best;
        ResultContext& context = outcome_.context;
        // A description that takes long after a stop is left: the estimate alone is stored then.
        work_.stop.shows(interrupted_result(result.estimate, context));
        work_.progress.within("description of the estimate");
        context.evidence.reason = "there is no estimate";
        if (!cycles_.cycles.empty()) count_cycles(cycles_, context);
        const orbits::CycleSearch& search = cycles_.cycles.empty() ? problem_.measured.search : cycles_;
        context.cycles_share_errors = best.residuals.cycles && problem_.measured.shares_unknown_errors(search.cycles);
        if (best.residuals.cycles && best.residuals.series.empty() && search.spline_map)
            context.blurred_jumps = causes_of_jumps(work_.job);
        const std::vector<ResidualRow> rows = describe_records(work_, problem_, setup_, search, best, context);
        context.unexplained = unexplained_spread(rows);
        context.whole_segments = !best.residuals.series.empty();
        work_.folder.store("residuals.csv", residuals_text(rows, asking_));
        if (best.is_evaluated()) {
            const auto all = best.residuals.all();
            context.posterior.diagnostics = identification::diagnose_residuals(all, best.estimate);
            context.evidence = evidence_of(work_.job, best.parameters, all, estimate_options(problem_, options_, *this),
                                           best.estimate);
        }
        work_.folder.store("result.json", result_text(result.estimate, context));
        work_.progress.within({});
    }

    [[nodiscard]] bool recall(const std::string& name, StageValue& value) override {
        return checkpoint_.recall(name, value);
    }
    void keep(const std::string& name, StageValue& value) override { checkpoint_.keep(name, value); }
    [[nodiscard]] bool recall(const std::string& name, std::vector<MatchingResult>& value) override {
        return checkpoint_.recall(name, value);
    }
    void keep(const std::string& name, std::vector<MatchingResult>& value) override { checkpoint_.keep(name, value); }
    [[nodiscard]] bool recall(const std::string& name, CriticismResult& value) override {
        return checkpoint_.recall(name, value);
    }
    void keep(const std::string& name, CriticismResult& value) override { checkpoint_.keep(name, value); }
    [[nodiscard]] bool recall(const std::string& name, AlternativeResult& value) override {
        return checkpoint_.recall(name, value);
    }
    void keep(const std::string& name, AlternativeResult& value) override { checkpoint_.keep(name, value); }

private:
    const Workspace& work_;
    const IdentificationProblem& problem_;
    EstimateOutcome& outcome_;
    Checkpoint checkpoint_;
    EstimateSetup setup_;
    BestSoFar best_;
    StepOutlook outlook_;
    identification::Options options_ = identification_options(work_.job);
    orbits::CycleSearch cycles_;  ///< with those of a harvest; empty: the measured ones
    std::function<bool()> asking_ = work_.asking();
    std::optional<RunStop::AtOnce> leaving_;
};

/// Profiles, marginals and draws at the estimate.
void explore(const Workspace& work, const IdentificationProblem& problem, JobObserver& observer, const StageRun& best,
             EstimateOutcome& outcome) {
    explore_posterior(work, best.parameters, best.residuals.all(), observer.setup().derived,
                      estimate_options(problem, identification_options(work.job), observer), outcome.estimate,
                      observer.checkpoint(), outcome.context.posterior);
    if (!work.interruption.asked() || outcome.estimate.status == estimator::EstimateStatus::interrupted) return;
    outcome.estimate.status = estimator::EstimateStatus::interrupted;
    outcome.estimate.message = "interrupted after the estimate, which is complete";
}

}  // namespace

EstimateOutcome run_estimate(const Workspace& work, const std::vector<Experiment>& data, JobCycles& cycles,
                             const std::function<void(JobCycles&)>& find) {
    EstimateOutcome outcome;
    IdentificationProblem problem = identification_problem(work.job, data);
    const auto add_cycles = [&] {
        add_measured_cycles(work.job, cycles.section ? &*cycles.section : nullptr, cycles.search, problem);
    };
    add_cycles();
    if (find)
        problem.measured.find = [&](identification::MeasuredCycles& measured) {
            find(cycles);
            add_cycles();
            measured.search = problem.measured.search;
            measured.section = problem.measured.section;
            measured.options = problem.measured.options;
            measured.plane = problem.measured.plane;
            count_cycles(cycles.search, outcome.context);
            outcome.context.orbits_missing = cycles.search.missing;
        };
    describe_data(work, data, cycles.search, outcome.context);
    JobObserver observer(work, problem, outcome);
    for (const auto& parameter : observer.setup().parameters)
        outcome.context.posterior.parameters.push_back(parameter.name);

    IdentificationResult result = identify(problem, identification_options(work.job), observer);
    outcome.estimate = std::move(result.estimate);
    work.stop.shows(interrupted_result(outcome.estimate, outcome.context));
    const bool estimated = result.best != nullptr;
    if (estimated) {
        outcome.context.strategy.matching = result.matching;
        outcome.context.strategy.criticism = result.comparison;
        explore(work, problem, observer, *result.best, outcome);
    }
    work.folder.store("result.json", result_text(outcome.estimate, outcome.context));
    if (estimated && !work.interruption.asked()) observer.checkpoint().remove();
    return outcome;
}

}  // namespace orbid::apps
