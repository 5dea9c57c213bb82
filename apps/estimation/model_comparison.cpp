#include "apps/estimation/model_comparison.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <set>

#include <fmt/format.h>

#include "apps/estimation/checkpoint_fields.hpp"
#include "apps/estimation/matching_check.hpp"
#include "apps/estimation/model_fit.hpp"
#include "apps/job/flow_stepper.hpp"
#include "estimator/exploration/evidence.hpp"
#include "estimator/exploration/predictive_score.hpp"
#include "models/catalogue/registry.hpp"
#include "orbits/records/data_error.hpp"
#include "orbits/series_residuals/continuity.hpp"

namespace orbid::apps {

namespace {

// Continuity sd over that of readings, at which models are compared: a wrong model held tighter creeps for hundreds of
// steps, and this one tells them apart by thousands already.
constexpr double compared_tightness = 1.0;
// Fits to the cycles that both models have; a third model that loses more each time is not worth a fourth.
constexpr int most_rounds = 3;

std::string own_name(const Job& job) {
    return job.model.variant.empty() ? job.model.name : "variant " + job.model.variant;
}

/// Errors of readings over their ranges at which exact matching ends at this share: the inverse of exact_matching().
double reading_noise(double share) {
    const bool noisy = share > orbits::exact_matching(orbits::noisy_readings);
    return share / (noisy ? orbits::noisy_tightness : orbits::exact_tightness);
}

/// What is compared is one stage of one model: nothing else that the job asks for runs again.
Job plain(const StageInput& input, const StageRun& run) {
    Job job = input.work.job;
    EstimateJob& estimate = *job.estimate;
    estimate.criticism = {};
    estimate.multi_start.starts = 1;
    estimate.sample.draws = 0;
    const auto share = matching_share(run);
    if (share && estimate.series->matching.kind != MatchingJob::Kind::estimated &&
        estimate.series->matching.kind != MatchingJob::Kind::given && !run.residuals.shooting.empty()) {
        // An estimated sd is part of the comparison, a given one the user's word.
        const bool exact = std::none_of(run.residuals.shooting.begin(), run.residuals.shooting.end(),
                                        [](const auto& one) { return one->groups().back().scale.estimate; });
        if (exact) estimate.series->matching = {MatchingJob::Kind::given, compared_tightness * reading_noise(*share)};
    }
    return job;
}

Job with_variant(Job job, const std::string& variant) {
    job.model.system = with_stepper(models::make_system(job.model.name, variant, job.model.size), job.stepper);
    job.model.variant = variant;
    return job;
}

Job without(Job job, Eigen::Index parameter) {
    auto& free = job.estimate->parameters;
    free.erase(std::remove_if(free.begin(), free.end(),
                              [&](const FreeParameterJob& one) { return one.parameter == parameter; }),
               free.end());
    job.model.values[parameter] = 0.0;
    for (DataJob& data : job.data) {
        data.free.erase(std::remove(data.free.begin(), data.free.end(), parameter), data.free.end());
        for (ParameterValue& own : data.parameters)
            if (own.parameter == parameter) own.value = 0.0;
    }
    return job;
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

estimator::PredictiveScore held_out(const ModelFit& model, const StageRun& run, double share) {
    estimator::PredictiveScore score;
    const int folds = std::max(2, static_cast<int>(std::lround(1.0 / share)));
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

/// An alternative beside the job's model, both on the same records.
class Comparison {
public:
    Comparison(const StageInput& input, const StageJob& stage, const StageRun& run)
        : input_(input), run_(run), nodes_(estimated_nodes(run)), job_(plain(input, run)) {
        // As a stage that begins where an estimate has ended.
        stage_.kind = StageJob::Kind::harvest;
        stage_.residuals = stage.residuals;
        from_start_ = {StageJob::Kind::residuals, stage.residuals};
        own_ = std::make_unique<ModelFit>(input, job_, nodes_);
        base_ = own_->fit(stage_, run.estimate);
        if (held_out_share() > 0.0) base_score_ = held_out(*own_, base_, held_out_share());
    }

    [[nodiscard]] const StageRun& base() const { return base_; }
    [[nodiscard]] const estimator::PredictiveScore& base_score() const { return base_score_; }
    [[nodiscard]] const Job& job() const { return job_; }

    AlternativeResult against(Job job, std::string name) {
        ModelFit model(input_, std::move(job), nodes_);
        StageRun other = model.fit(from_start_, run_.estimate);
        std::optional<StageRun> fewer;  // the job's model on the common cycles
        for (int round = 0; round < most_rounds; ++round) {
            const auto mine = used_cycles(fewer ? *fewer : base_);
            const auto theirs = used_cycles(other);
            if (mine == theirs || mine.empty() || theirs.empty()) break;
            std::set<std::size_t> common;
            std::set_intersection(mine.begin(), mine.end(), theirs.begin(), theirs.end(),
                                  std::inserter(common, common.end()));
            const orbits::CycleSearch part = part_of(model.cycles(), common);
            ModelFit own(input_, job_, nodes_);
            own.set_cycles(part);
            model.set_cycles(part);
            const estimator::Estimate theirs_before = other.estimate;
            fewer = own.fit(stage_, run_.estimate);
            other = model.fit(stage_, theirs_before);
        }
        return describe(model, other, fewer ? *fewer : base_, !fewer, std::move(name));
    }

private:
    [[nodiscard]] double held_out_share() const { return input_.work.job.estimate->criticism.held_out; }

    AlternativeResult describe(const ModelFit& model, const StageRun& other, const StageRun& own, bool all,
                               std::string name) const {
        AlternativeResult result;
        result.name = std::move(name);
        result.status = other.result.status;
        result.message = other.result.message;
        result.parameters = other.estimate.parameters;
        result.used = used_blocks(other);
        if (!other.usable()) {
            result.ln_bayes_factor.reason = fmt::format("its fit: {}, {}", other.result.status, other.result.message);
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
            const auto mine = all ? base_score_ : held_out(*own_, own, held_out_share());
            compare_scores(mine, held_out(model, other, held_out_share()), result);
        }
        return result;
    }

    const StageInput& input_;
    const StageRun& run_;
    std::vector<std::vector<Eigen::MatrixXd>> nodes_;
    Job job_;
    StageJob stage_;
    StageJob from_start_;
    std::unique_ptr<ModelFit> own_;
    StageRun base_;
    estimator::PredictiveScore base_score_;
};

}  // namespace

CriticismResult criticise(const StageInput& input, const StageJob& stage, const StageRun& run) {
    const Job& job = input.work.job;
    const CriticismJob& asked = job.estimate->criticism;
    CriticismResult result;
    result.model = own_name(job);
    result.stage = stage.name();
    const double models = static_cast<double>(asked.variants.size() + asked.without.size()) + 1.0;
    if (input.checkpoint->recall("criticism", result)) {
        input.work.progress.reused("criticism", fmt::format("{} models compared", result.alternatives.size() + 1));
        return result;
    }
    input.work.progress.begin("criticism", models, "models");
    Comparison comparison(input, stage, run);
    input.work.progress.advance(1.0);
    result.large_defects = large_defects(input, comparison.base());
    result.intervals = used_blocks(comparison.base());
    if (asked.held_out > 0.0) {
        result.score = told(comparison.base_score());
        result.score_error = comparison.base_score().standard_error;
    }
    const auto add = [&](Job other, std::string name) {
        if (input.work.interruption.asked()) return;
        AlternativeResult known;
        if (input.checkpoint->recall("criticism " + name, known)) {
            result.alternatives.push_back(std::move(known));
            input.work.progress.advance(1.0);
            return;
        }
        try {
            result.alternatives.push_back(comparison.against(std::move(other), name));
        } catch (const orbits::DataError& error) {
            // What this model makes of the data does not stop the others.
            AlternativeResult& failed = result.alternatives.emplace_back();
            failed.name = name;
            failed.status = estimator::name(estimator::EstimateStatus::failed);
            failed.message = error.what();
            failed.ln_bayes_factor.reason = error.what();
        }
        if (!input.work.interruption.asked()) input.checkpoint->keep("criticism " + name, result.alternatives.back());
        input.work.progress.advance(1.0);
    };
    for (const std::string& variant : asked.variants)
        add(with_variant(comparison.job(), variant), "variant " + variant);
    for (const Eigen::Index parameter : asked.without)
        add(without(comparison.job(), parameter), fmt::format("without {}", job.model.parameter(parameter).name));
    if (!input.work.interruption.asked()) input.checkpoint->keep("criticism", result);
    input.work.progress.end(fmt::format("{} models compared", result.alternatives.size() + 1));
    return result;
}

}  // namespace orbid::apps
