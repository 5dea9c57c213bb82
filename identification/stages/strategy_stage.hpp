#pragma once

#include <functional>
#include <string>
#include <vector>

#include "estimator/estimate/estimate.hpp"
#include "estimator/exploration/multi_start.hpp"
#include "identification/problem/estimate_setup.hpp"
#include "identification/problem/identification_options.hpp"
#include "identification/problem/identification_result.hpp"
#include "identification/problem/observer.hpp"
#include "identification/problem/problem_residuals.hpp"
#include "identification/starts/course_repair.hpp"
#include "identification/starts/series_nodes.hpp"
#include "orbits/cycles/cycle_search.hpp"

namespace orbid::identification {

/// Options of the final minimisation of each stage.
[[nodiscard]] estimator::EstimateOptions estimate_options(const IdentificationProblem& problem, const Options& options,
                                                          Observer& observer);

/// What several starts have come to.
struct StartResults {
    std::vector<estimator::Optimum> optima;
    std::vector<estimator::StartedRun> runs;
};

/// What the stages of one model share.
struct StageInput {
    const IdentificationProblem& problem;
    const Options& options;
    Observer& observer;
    const EstimateSetup& setup;
    const models::ParameterBinding& cycle_binding;
    const ProblemResiduals& prepared;  ///< single shooting and waveforms, which stages copy
    estimator::EstimateOptions estimate;
    orbits::CycleSearch search;      ///< a harvest adds to it
    StartResults* starts = nullptr;  ///< report of several starts, if the options ask for them
    SeriesStart nodes;               ///< intervals and nodes of series; without any they are searched for or guessed
    bool kept = false;               ///< the observer keeps what stages come to, for a run that continues
    std::vector<FollowedStates> followed = {};  ///< states along the records, by the best stage so far
    /// Makes measured cycles known, `search` too, before the first stage that uses them; empty: they are.
    std::function<void()> find_cycles = {};
    SignChoices signs = {};  ///< that nothing tells, see StructuralReport
    /// Why a minimisation was left for another way, as a sentence without its end; what it came to is then not kept.
    std::string left = {};
};

/// A finished stage, with the input of its estimate.
struct StageRun {
    StageResult result;
    std::vector<estimator::FreeParameter> parameters;  ///< with the starts of the minimisation
    ProblemResiduals residuals;
    estimator::Estimate estimate;

    /// Whether later stages may start from its estimate and results may show it.
    [[nodiscard]] bool succeeded() const {
        return estimate.status == estimator::EstimateStatus::converged ||
               estimate.status == estimator::EstimateStatus::singular;
    }
    /// Whether it has numbers at all.
    [[nodiscard]] bool usable() const;
    /// Whether the estimate has a value for every record.
    [[nodiscard]] bool is_evaluated() const;
    /// Whether it could not run.
    [[nodiscard]] bool skipped() const;
};

/// Runs one stage from the starts of `parameters`, or restores it from what the observer has kept, the same to the bit.
/// @param before  the best of the earlier stages, from which a harvest starts; nullptr: none has run.
/// @param name    under which it is kept.
/// @throws orbits::DataError when the data do not suffice for its residuals.
[[nodiscard]] StageRun run_stage(StageInput& input, const Stage& stage,
                                 const std::vector<estimator::FreeParameter>& parameters, const StageRun* before,
                                 const std::string& name);

/// States along the records at the estimate of a stage: the nodes of its series. Empty without any.
[[nodiscard]] std::vector<FollowedStates> followed_states(const StageRun& run);

/// Only the minimisation of a stage: harvested cycles are already added, and the parameters of the cycles are near it.
/// @throws orbits::DataError as run_stage.
[[nodiscard]] StageRun fit_stage(StageInput& input, const Stage& stage,
                                 const std::vector<estimator::FreeParameter>& parameters);

/// The binding of parameters for the cycles' model: that of the searched experiment, or the model's own.
[[nodiscard]] const models::ParameterBinding& searched_binding(const IdentificationProblem& problem,
                                                               const EstimateSetup& setup);

}  // namespace orbid::identification
