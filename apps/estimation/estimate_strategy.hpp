#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "apps/estimation/estimate_residuals.hpp"
#include "apps/estimation/estimate_setup.hpp"
#include "apps/results/checkpoint.hpp"
#include "apps/results/result_file.hpp"
#include "apps/stages/data_stage.hpp"
#include "apps/stages/searched_section.hpp"
#include "apps/stages/workspace.hpp"
#include "estimator/estimate/estimate.hpp"
#include "orbits/cycles/cycle_search.hpp"

namespace orbid::apps {

/// What the stages of one model share.
struct StageInput {
    const Workspace& work;  ///< its job is the model's
    const std::vector<Experiment>& data;
    const SearchedSection* section = nullptr;  ///< where cycles were searched for; none: they come from a file
    const EstimateSetup& setup;
    const models::ParameterBinding& cycle_binding;
    const JobResiduals& prepared;  ///< single shooting and waveforms, which stages copy
    estimator::EstimateOptions options;
    orbits::CycleSearch search;          ///< a harvest adds to it
    PosteriorResults* starts = nullptr;  ///< where several starts are told of, when the job asks for them
    /// Nodes that series begin from: by experiment of the series, by fitted segment; empty: guessed.
    std::vector<std::vector<Eigen::MatrixXd>> nodes;
    Checkpoint* checkpoint = nullptr;  ///< what stages leave to a run that goes on; none: nothing
};

/// A stage that has run, with what its estimate was made from.
struct StageRun {
    StageResult result;
    std::vector<estimator::FreeParameter> parameters;  ///< with the starts of the minimisation
    JobResiduals residuals;
    estimator::Estimate estimate;

    /// Has an estimate that later stages may start from, and a result may show.
    [[nodiscard]] bool succeeded() const {
        return estimate.status == estimator::EstimateStatus::converged ||
               estimate.status == estimator::EstimateStatus::singular;
    }
    /// Has numbers at all.
    [[nodiscard]] bool usable() const;
};

/// Runs one stage from the starts of `parameters`, or takes what the checkpoint knows of it: the same to the bit.
/// @param before  the best of the stages before: what a harvest looks from; nullptr: none has run.
/// @param name    in the checkpoint.
/// @throws orbits::DataError when the data cannot serve its residuals.
[[nodiscard]] StageRun run_stage(StageInput& input, const StageJob& stage,
                                 const std::vector<estimator::FreeParameter>& parameters, const StageRun* before,
                                 const std::string& name);

/// The minimisation of a stage alone: what a harvest adds is there already, and the cycles' parameters near it.
/// @throws orbits::DataError as run_stage.
[[nodiscard]] StageRun fit_stage(StageInput& input, const StageJob& stage,
                                 const std::vector<estimator::FreeParameter>& parameters);

/// How the model that cycles belong to sees the parameters: the experiment that was searched, or the model's own.
[[nodiscard]] const models::ParameterBinding& searched_binding(const Job& job, const EstimateSetup& setup);

/// What the stages of a strategy came to.
struct StrategyRun {
    /// The last stage that succeeded, or if none did the last one with numbers; empty: none has run.
    std::optional<StageRun> best;
    std::vector<StageResult> stages;                                     ///< in their order
    estimator::EstimateStatus last = estimator::EstimateStatus::failed;  ///< of the last stage that was not skipped
    int iterations = 0;                                                  ///< of all stages
    int evaluations = 0;
};

/// Runs stages one after the other, each from the best before it; after an interruption none begins.
/// @param stored  called after every stage with what there is by then.
[[nodiscard]] StrategyRun run_strategy(StageInput& input, const std::vector<StageJob>& stages,
                                       const std::vector<estimator::FreeParameter>& parameters,
                                       const std::function<void(const StrategyRun&)>& stored);

/// The estimate of a strategy: that of its best stage, with the status of the last one. A stage that failed after
/// another had succeeded loses nothing, but is told.
[[nodiscard]] estimator::Estimate strategy_estimate(const StrategyRun& strategy, bool interrupted);

}  // namespace orbid::apps
