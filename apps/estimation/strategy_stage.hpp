#pragma once

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
    const SearchedSection* section = nullptr;  ///< searched for cycles; none: they come from a file
    const EstimateSetup& setup;
    const models::ParameterBinding& cycle_binding;
    const JobResiduals& prepared;  ///< single shooting and waveforms, which stages copy
    estimator::EstimateOptions options;
    orbits::CycleSearch search;          ///< a harvest adds to it
    PosteriorResults* starts = nullptr;  ///< report of several starts, if the job requests them
    /// Start nodes of series: by experiment of the series, by fitted segment; empty: guessed.
    std::vector<std::vector<Eigen::MatrixXd>> nodes;
    Checkpoint* checkpoint = nullptr;  ///< where stages store results for a run that continues; may be null
};

/// A finished stage, with the input of its estimate.
struct StageRun {
    StageResult result;
    std::vector<estimator::FreeParameter> parameters;  ///< with the starts of the minimisation
    JobResiduals residuals;
    estimator::Estimate estimate;

    /// Whether later stages may start from its estimate and results may show it.
    [[nodiscard]] bool succeeded() const {
        return estimate.status == estimator::EstimateStatus::converged ||
               estimate.status == estimator::EstimateStatus::singular;
    }
    /// Whether it has numbers at all.
    [[nodiscard]] bool usable() const;
    /// Whether it could not run.
    [[nodiscard]] bool skipped() const;
};

/// Runs one stage from the starts of `parameters`, or restores it from the checkpoint, the same to the bit.
/// @param before  the best of the earlier stages, from which a harvest starts; nullptr: none has run.
/// @param name    in the checkpoint.
/// @throws orbits::DataError when the data do not suffice for its residuals.
[[nodiscard]] StageRun run_stage(StageInput& input, const StageJob& stage,
                                 const std::vector<estimator::FreeParameter>& parameters, const StageRun* before,
                                 const std::string& name);

/// Only the minimisation of a stage: harvested cycles are already added, and the parameters of the cycles are near it.
/// @throws orbits::DataError as run_stage.
[[nodiscard]] StageRun fit_stage(StageInput& input, const StageJob& stage,
                                 const std::vector<estimator::FreeParameter>& parameters);

/// The binding of parameters for the cycles' model: that of the searched experiment, or the model's own.
[[nodiscard]] const models::ParameterBinding& searched_binding(const Job& job, const EstimateSetup& setup);

}  // namespace orbid::apps
