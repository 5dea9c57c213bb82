#include "identification/comparison/model_comparison.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <set>

#include <fmt/format.h>

#include "estimator/exploration/evidence.hpp"
#include "estimator/exploration/predictive_score.hpp"
#include "identification/comparison/matching_check.hpp"
#include "identification/comparison/model_fit.hpp"
#include "identification/stages/stage_value.hpp"
#include "orbits/records/data_error.hpp"
#include "orbits/series_residuals/continuity.hpp"

namespace orbid::identification {

namespace {

// Continuity sd over that of readings, at which models are compared: a wrong model held tighter creeps for hundreds of
// steps, and this one tells them apart by thousands already.
constexpr double compared_tightness = 1.0;
// Fits to the cycles that both models have; a third model that loses more each time is not worth a fourth.
constexpr int most_rounds = 3;

/// The problem whose matching is loosened to what models are compared at.
IdentificationProblem compared_problem(const StageInput& input, const StageRun& run) {
    IdentificationProblem problem = input.problem;
    const auto noise = matched_noise(run);
    if (noise && problem.series->matching.kind != Matching::Kind::estimated &&
        problem.series->matching.kind != Matching::Kind::given && !run.residuals.shooting.empty()) {
        // An estimated sd is part of the comparison, a given one the user's word.
        const bool exact = std::none_of(run.residuals.shooting.begin(), run.residuals.shooting.end(),
                                        [](const auto& one) { return one->groups().back().scale.estimate; });
        if (exact) problem.series->matching = {Matching::Kind::given, compared_tightness * *noise};
    }
    return problem;
}

IdentificationProblem without(IdentificationProblem problem, Eigen::Index parameter) {
    auto& free = problem.parameters;
    free.erase(std::remove_if(free.begin(), free.end(),
                              [&](const FreeModelParameter& one) { return one.parameter == parameter; }),
               free.end());
    problem.values[parameter] = 0.0;
    for (Experiment& data : problem.experiments) {
        data.free.erase(std::remove(data.free.begin(), data.free.end(), parameter), data.free.end());
        for (ParameterValue& own : data.parameters)
            if (own.parameter == parameter) own.value = 0.0;
    }
    return problem;
}

IdentificationProblem altered(IdentificationProblem problem, const Alternative& alternative) {
    if (alternative.system) problem.system = alternative.system;
    return alternative.without >= 0 ? without(std::move(problem), alternative.without) : problem;
}

/// Indices of the cycles that an estimate used.
std::set<std::size_t> used_cycles(const StageRun& run) {
    std::set<std::size_t> used;
    if (!run.residuals.cycles || run.estimate.residuals.empty()) return used;
    const auto& blocks = run.estimate.residuals.front();
    for (std::size_t b = 0; b < blocks.size(); ++b)
        if (blocks[b].e.size() > 0) used.insert(run.residuals.cycles->cycle_of(b));
    return used;
}

orbits::CycleSearch part_of(const orbits::CycleSearch& search, const std::set<std::size_t>& kept) {
    orbits::CycleSearch part = search;
    part.cycles.clear();
    for (const std::size_t index : kept) {
        part.cycles.push_back(search.cycles[index]);
        // One of every pair is left, which needs no partner.
        part.cycles.back().mirror.reset();
    }
    return part;
}

std::size_t used_blocks(const StageRun& run) {
    std::size_t used = 0;
    for (const auto& residual : run.estimate.residuals)
        used += static_cast<std::size_t>(
            std::count_if(residual.begin(), residual.end(), [](const auto& block) { return block.e.size() > 0; }));
    return used;
}

std::optional<std::size_t> large_defects(const StageInput& input, const StageRun& run) {
    if (run.residuals.shooting.empty()) return std::nullopt;
    std::size_t large = 0;
    for (const MatchingResult& matching : matching_results(input, run, false))
        large += matching.large;
    return large;
}

estimator::PredictiveScore held_out(Observer& observer, const ModelFit& model, const StageRun& run, double share) {
    estimator::PredictiveScore score;
    const int folds = std::max(2, static_cast<int>(std::lround(1.0 / share)));
    observer.within(fmt::format("{} folds left out in turn", folds));
    try {
        return estimator::predictive_score(run.parameters, run.residuals.all(), model.options(), run.estimate, folds);
    } catch (const orbits::DataError& error) {
        score.message = error.what();
    }
    return score;
}

LogEvidence told(const estimator::PredictiveScore& score) {
    return score.known ? LogEvidence{score.log_density, {}} : LogEvidence{std::nullopt, score.message};
}

/// Difference of two scores of the same folds, and its sd from their scatter.
void compare_scores(const estimator::PredictiveScore& own, const estimator::PredictiveScore& other,
                    AlternativeResult& result) {
    if (!own.known || !other.known || own.folds.size() != other.folds.size()) {
        result.score.reason = !own.known ? own.message : other.message;
        return;
    }
    const auto count = static_cast<double>(own.folds.size());
    double sum = 0.0;
    double square = 0.0;
    for (std::size_t k = 0; k < own.folds.size(); ++k) {
        const double difference = own.folds[k].log_density - other.folds[k].log_density;
        sum += difference;
        square += difference * difference;
    }
    result.score.value = sum;
    if (count > 1.0) result.score_error = std::sqrt(std::max(square - sum * sum / count, 0.0) * count / (count - 1.0));
}

/// An alternative beside the problem's model, both on the same records.
class Comparison {
public:
    Comparison(const StageInput& input, const Stage& stage, const StageRun& run)
        : input_(input), run_(run), nodes_(estimated_nodes(run)), problem_(compared_problem(input, run)) {
        // As a stage that begins where an estimate has ended.
        stage_.kind = Stage::Kind::harvest;
        stage_.residuals = stage.residuals;
        from_start_ = {Stage::Kind::residuals, stage.residuals};
        own_ = std::make_unique<ModelFit>(input, problem_, input.options.comparison.model, nodes_);
        base_ = own_->fit(stage_, run.estimate);
        if (held_out_share() > 0.0) base_score_ = held_out(input.observer, *own_, base_, held_out_share());
    }

    [[nodiscard]] const StageRun& base() const { return base_; }
    [[nodiscard]] const estimator::PredictiveScore& base_score() const { return base_score_; }

    AlternativeResult against(const Alternative& alternative) {
        ModelFit model(input_, altered(problem_, alternative), alternative.name, nodes_);
        StageRun other = model.fit(from_start_, run_.estimate);
        std::optional<StageRun> fewer;  // the problem's model on the common cycles
        for (int round = 0; round < most_rounds; ++round) {
            const auto mine = used_cycles(fewer ? *fewer : base_);
            const auto theirs = used_cycles(other);
            if (mine == theirs || mine.empty() || theirs.empty()) break;
            std::set<std::size_t> common;
            std::set_intersection(mine.begin(), mine.end(), theirs.begin(), theirs.end(),
                                  std::inserter(common, common.end()));
            const orbits::CycleSearch part = part_of(model.cycles(), common);
            ModelFit own(input_, problem_, input_.options.comparison.model, nodes_);
            own.set_cycles(part);
            model.set_cycles(part);
            const estimator::Estimate theirs_before = other.estimate;
            fewer = own.fit(stage_, run_.estimate);
            other = model.fit(stage_, theirs_before);
        }
        return describe(model, other, fewer ? *fewer : base_, !fewer, alternative.name);
    }

private:
    [[nodiscard]] double held_out_share() const { return input_.options.comparison.held_out; }

    AlternativeResult describe(const ModelFit& model, const StageRun& other, const StageRun& own, bool all,
                               std::string name) const {
        AlternativeResult result;
        result.name = std::move(name);
        result.status = other.result.status;
        result.message = other.result.message;
        result.parameters = other.estimate.parameters;
        result.used = used_blocks(other);
        if (!other.usable()) {
            result.ln_bayes_factor.reason =
                fmt::format("its fit: {}, {}", status_name(other.result.status), other.result.message);
            result.score.reason = result.ln_bayes_factor.reason;
            return result;
        }
        result.large_defects = large_defects(input_, other);
        result.objective_difference = other.estimate.objective - own.estimate.objective;
        const auto terms = [](const StageRun& run, const estimator::EstimateOptions& options) {
            return estimator::evidence_terms(run.parameters, run.residuals.all(), options, run.estimate);
        };
        const auto evidence = estimator::log_bayes_factor(terms(own, own_->options()), terms(other, model.options()));
        if (evidence.known) {
            result.ln_bayes_factor.value = evidence.value;
            result.ln_bayes_factor_uncertainty = evidence.uncertainty;
        } else {
            result.ln_bayes_factor.reason = evidence.message;
        }
        if (held_out_share() > 0.0) {
            const auto mine = all ? base_score_ : held_out(input_.observer, *own_, own, held_out_share());
            compare_scores(mine, held_out(input_.observer, model, other, held_out_share()), result);
        }
        return result;
    }

    const StageInput& input_;
    const StageRun& run_;
    SeriesStart nodes_;
    IdentificationProblem problem_;
    Stage stage_;
    Stage from_start_;
    std::unique_ptr<ModelFit> own_;
    StageRun base_;
    estimator::PredictiveScore base_score_;
};

}  // namespace

ComparisonResult criticise(const StageInput& input, const Stage& stage, const StageRun& run) {
    const ComparisonOptions& asked = input.options.comparison;
    ComparisonResult result;
    result.model = asked.model;
    result.stage = stage.name();
    const double models = static_cast<double>(asked.alternatives.size()) + 1.0;
    if (input.observer.recall("criticism", result)) {
        input.observer.recalled("criticism", fmt::format("{} models compared", result.alternatives.size() + 1));
        return result;
    }
    input.observer.begin("criticism", models, "models");
    double done = 0.0;
    Comparison comparison(input, stage, run);
    input.observer.at(++done, {});
    result.large_defects = large_defects(input, comparison.base());
    result.intervals = used_blocks(comparison.base());
    if (asked.held_out > 0.0) {
        result.score = told(comparison.base_score());
        result.score_error = comparison.base_score().standard_error;
    }
    for (const Alternative& alternative : asked.alternatives) {
        if (input.observer.stopped()) break;
        const std::string& name = alternative.name;
        AlternativeResult known;
        if (input.observer.recall("criticism " + name, known)) {
            result.alternatives.push_back(std::move(known));
            input.observer.at(++done, {});
            continue;
        }
        try {
            result.alternatives.push_back(comparison.against(alternative));
        } catch (const orbits::DataError& error) {
            // What this model makes of the data does not stop the others.
            AlternativeResult& failed = result.alternatives.emplace_back();
            failed.name = name;
            failed.status = estimator::EstimateStatus::failed;
            failed.message = error.what();
            failed.ln_bayes_factor.reason = error.what();
        }
        if (!input.observer.stopped()) input.observer.keep("criticism " + name, result.alternatives.back());
        input.observer.at(++done, {});
    }
    if (!input.observer.stopped()) input.observer.keep("criticism", result);
    input.observer.end(fmt::format("{} models compared", result.alternatives.size() + 1));
    return result;
}

}  // namespace orbid::identification
