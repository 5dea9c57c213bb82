#include "identification/strategy/identify.hpp"

#include <algorithm>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include "identification/comparison/matching_check.hpp"
#include "identification/comparison/model_comparison.hpp"
#include "identification/stages/series_doubt.hpp"
#include "identification/stages/strategy_run.hpp"
#include "identification/starts/derivative_self_check.hpp"
#include "identification/starts/whole_segments.hpp"
#include "identification/structure/structural_check.hpp"

namespace orbid::identification {

namespace {

/// What is said of the matching of nodes, and of other models.
void criticise_result(const StageInput& input, const StageRun& best, IdentificationResult& result) {
    const auto chosen =
        std::find_if(result.stages.begin(), result.stages.end(), [](const StageResult& one) { return one.chosen; });
    if (chosen == result.stages.end() || !best.is_evaluated()) return;
    const Stage& stage = input.options.strategy[static_cast<std::size_t>(chosen - result.stages.begin())];
    if (!input.observer.recall("matching", result.matching)) {
        input.observer.within("matching of nodes");
        result.matching = matching_results(input, best, !input.observer.stopped());
        input.observer.within({});
        if (!input.observer.stopped()) input.observer.keep("matching", result.matching);
    }
    if (!input.options.comparison.any() || input.observer.stopped()) return;
    if (stage.kind == Stage::Kind::prediction || !best.succeeded()) {
        input.observer.remark("other models are not compared: there is no estimate to compare them with");
        return;
    }
    result.comparison = criticise(input, stage, best);
}

/// What the readings can determine is told, and what they cannot is held.
StructuralReport examined_structure(const IdentificationProblem& problem, EstimateSetup& setup, Observer& observer) {
    observer.within("what the readings can determine");
    StructuralReport report = structural_report(problem, setup);
    hold(report, setup.parameters);
    for (const std::string& line : remarks(report))
        observer.remark(line);
    if (!report.reason.empty()) observer.detail("what the readings can determine was not examined: " + report.reason);
    return report;
}

void find_cycles(MeasuredCycles& measured, StageInput& input) {
    measured.find(measured);
    input.search = measured.search;
}

void drop_blocks(estimator::Estimate& estimate) {
    estimate.active = {};
    estimate.latents = {};
    estimate.latent_sds = {};
    estimate.residuals = {};
}

void take_blocks(const estimator::Estimate& from, estimator::Estimate& estimate) {
    estimate.active = from.active;
    estimate.latents = from.latents;
    estimate.latent_sds = from.latent_sds;
    estimate.residuals = from.residuals;
}

void add_held(const StructuralReport& structure, std::string& message) {
    for (const UndeterminedDirection& direction : structure.directions)
        message +=
            fmt::format("{}{} was held at its start: {}", message.empty() ? "" : "; ", direction.held, direction.text);
}

/// The stages of one problem, and what follows their best.
class Identification {
public:
    Identification(IdentificationProblem problem, const Options& given, Observer& observer)
        : problem_(std::move(problem)), options_(given), observer_(observer) {
        if (options_.strategy.empty()) options_.strategy = automatic_strategy(problem_);
        check_strategy(problem_, options_.strategy);
        setup_ = estimate_setup(problem_, fitted_labels(problem_));
    }
    Identification(const Identification&) = delete;
    Identification& operator=(const Identification&) = delete;

    /// All stages.
    void run() {
        prepare();
        strategy_ = run_strategy(*input_, options_.strategy, setup_.parameters, [&](const StrategyRun& run) {
            take(run);
            observer_.stage_ended(result_);
        });
    }

    /// Comparisons of the best stage. @return everything; nothing else can be asked then
    [[nodiscard]] IdentificationResult finish() {
        take(strategy_);
        if (!strategy_.best || strategy_.best->residuals.all().empty()) {
            observer_.end(result_.estimate.message);
            return std::move(result_);
        }
        const auto best = std::make_shared<const StageRun>(std::move(*strategy_.best));
        result_.best = best;
        observer_.estimated(result_);
        // What an estimate has for every block is not held twice beside another estimate.
        drop_blocks(result_.estimate);
        criticise_result(*input_, *best, result_);
        take_blocks(best->estimate, result_.estimate);
        return std::move(result_);
    }

    /// An interruption kept what should have followed from running.
    void leave_unfinished() { strategy_.unfinished = true; }

    [[nodiscard]] const IdentificationProblem& problem() const { return problem_; }
    [[nodiscard]] const Options& options() const { return options_; }
    [[nodiscard]] const StrategyRun& strategy() const { return strategy_; }

    /// Ends a minimisation over whole segments that comes to where no course in one piece can follow them. It could
    /// wander there for minutes.
    void leave_where_errors_grow() { leaves_growth_ = true; }
    /// Where it was ended so, see StageInput::left; empty: it was not.
    [[nodiscard]] const std::string& left() const { return input_->left; }

private:
    /// After ten steps, then after as many again: each look takes an evaluation with derivatives.
    void watch_growth(estimator::EstimateOptions& estimate) {
        estimate.watched = [this, told = estimate.watched, next = 10](const estimator::StepReport& report) mutable {
            told(report);
            const bool over = report.phase != estimator::StepReport::Phase::minimisation || !input_->left.empty();
            if (over || report.iteration < next) return;
            next = 2 * report.iteration;
            input_->left = unbearable_growth(problem_, prepared_, report.theta);
        };
        estimate.interrupted = [this, asked = estimate.interrupted] { return asked() || !input_->left.empty(); };
    }

    void prepare() {
        if (options_.strategy.size() <= 1) observer_.begin("estimate", 0.0, {});
        observer_.within("first solutions");
        add_series(problem_, setup_, prepared_);
        // A later stage of waveforms begins where the one before it ends.
        if (options_.strategy.front().uses(ResidualType::waveform))
            for (const std::string& line : add_waveform(problem_, setup_, setup_.start(), prepared_.waveform))
                observer_.remark(line);
        for (const std::string& lost : add_branch(problem_, setup_, setup_.start(), prepared_.branch))
            observer_.remark(lost);
        const models::ParameterBinding& cycle_binding = searched_binding(problem_, setup_);
        if (const auto flow = first_flow(problem_, setup_, prepared_, cycle_binding, options_.seed))
            observer_.detail(compare_derivatives(*flow));
        result_.structure = examined_structure(problem_, setup_, observer_);
        observer_.within({});
        input_.emplace(StageInput{problem_,
                                  options_,
                                  observer_,
                                  setup_,
                                  cycle_binding,
                                  prepared_,
                                  estimate_options(problem_, options_, observer_),
                                  problem_.measured.search,
                                  &starts_,
                                  {},
                                  true});
        input_->signs = result_.structure.signs;
        if (leaves_growth_) watch_growth(input_->estimate);
        if (problem_.measured.find) input_->find_cycles = [this] { find_cycles(problem_.measured, *input_); };
    }

    void take(const StrategyRun& run) {
        result_.stages = run.stages;
        result_.estimate = strategy_estimate(run, observer_.stopped());
        add_held(result_.structure, result_.estimate.message);
        result_.optima = starts_.optima;
        result_.runs = starts_.runs;
        result_.cycles = input_->search.cycles;
    }

    IdentificationProblem problem_;
    Options options_;
    Observer& observer_;
    EstimateSetup setup_;
    ProblemResiduals prepared_;
    StartResults starts_;
    std::optional<StageInput> input_;
    StrategyRun strategy_;
    IdentificationResult result_;
    bool leaves_growth_ = false;
};

bool succeeded(const Identification& identification) {
    return identification.strategy().best && identification.strategy().best->succeeded();
}

/// Why a series over whole segments needs nodes; empty: it does not.
std::string need_of_nodes(const Identification& whole) {
    if (!may_need_nodes(whole.problem(), whole.options().strategy)) return {};
    if (!whole.left().empty()) return whole.left();
    const auto& best = whole.strategy().best;
    return best ? whole_segments_doubt(*best) : "it could not run";
}

}  // namespace

IdentificationResult identify(const IdentificationProblem& asked, const Options& given, Observer& observer) {
    validate(given);
    IdentificationProblem problem = completed(asked);
    if (const std::string found = divide_where_errors_grow(problem); !found.empty()) observer.remark(found);
    std::optional<Identification> whole(std::in_place, problem, given, observer);
    // One of several starts may go astray.
    if (given.starts <= 1 && may_need_nodes(problem, whole->options().strategy)) whole->leave_where_errors_grow();
    whole->run();
    const std::string need = observer.stopped() ? std::string() : need_of_nodes(*whole);
    if (need.empty()) return whole->finish();
    observer.remark(fmt::format(
        "the series over whole segments is not explained ({}): once more with nodes, as with \"interval\": \"auto\"",
        need));
    IdentificationProblem finer = whole->problem();
    finer.series->interval = SeriesChoice::automatic_interval;
    Identification divided(std::move(finer), given, observer);
    divided.run();
    const bool explained =
        succeeded(divided) && series_doubt(*divided.problem().system, *divided.strategy().best).empty();
    if (explained) return divided.finish();
    if (!whole->left().empty() && !observer.stopped()) {
        observer.remark("nodes do not explain it either: whole segments once more, to the end");
        whole.emplace(std::move(problem), given, observer);
        whole->run();
    }
    if (succeeded(divided) && !succeeded(*whole)) return divided.finish();
    if (observer.stopped())
        whole->leave_unfinished();
    else
        observer.remark("nodes explain it no better: the result is that of whole segments");
    return whole->finish();
}

IdentificationResult identify(const IdentificationProblem& problem, const Options& options) {
    Observer observer;
    return identify(problem, options, observer);
}

}  // namespace orbid::identification
