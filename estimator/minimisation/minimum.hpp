#pragma once

#include <functional>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "estimator/interface/estimate_result.hpp"
#include "estimator/minimisation/error_parameter.hpp"
#include "estimator/problem/linearisation.hpp"
#include "estimator/problem/problem.hpp"

namespace orbid::estimator {

enum class Outcome { converged, no_progress, iteration_limit, interrupted, blocks_stopped, start_failed, no_freedom };

/// The end of one minimisation with a frozen set of blocks.
struct Minimum {
    Outcome outcome = Outcome::start_failed;
    std::string message;
    Evaluation evaluation;        ///< at the state; its values stay only where `rows` are shortened, see linearise()
    BlockErrors errors;           ///< at the state
    std::vector<BlockRows> rows;  ///< linearisation at the state
    PriorModel prior;             ///< at the state
    BoundedStep step;             ///< the remaining full step: its basis and active bounds describe the minimum
    std::vector<std::size_t> stopped;    ///< blocks that stopped three steps in a row, or failed at the start
    std::vector<bool> error_at_floor;    ///< error parameters held at their lower limit
    std::vector<bool> error_at_ceiling;  ///< and at the upper one
    /// Weight of the constraints at the end: the size of a violation that costs 1/2, in units of their sizes.
    double matching = 1.0;
    double remaining = 0.0;  ///< length of the remaining full step, in posterior sds
    bool kink = false;       ///< several smooth pieces of the objective meet here; `step` is that of one of them

    /// Makes rows and errors from the evaluation, whose values are freed where the rows hold all of them: with latent
    /// states there are many blocks of few records.
    void take_rows(const Problem& problem, const BlockSet& set, const State& state);
    /// Rows of all records, none shortened, at the state.
    [[nodiscard]] std::vector<BlockRows> all_rows(const Problem& problem, const BlockSet& set,
                                                  const State& state) const;
};

/// Counters and history over all rounds.
struct SolverStatistics {
    int round = 0;
    int iterations = 0;  ///< accepted steps of theta
    int trials = 0;      ///< accepted and rejected ones
    int evaluations = 0;
    std::vector<StepRecord> history;
};

/// Tells whoever watches the estimate; completes `report` by the place that is reached.
void tell_step(StepReport report, const Problem& problem, const Eigen::VectorXd& theta);

/// For messages.
[[nodiscard]] std::string two_figures(double value);

/// Problem of the error parameters at a linearisation, to which it refers.
[[nodiscard]] ErrorProblem error_problem(const Problem& problem, const BlockSet& set, const Minimum& minimum,
                                         Follow follow);

/// Minimises (M8)/(M9) over theta, latent states and scales with the given blocks; (M11) with a trust region.
///
/// theta- and latent steps decrease Phi at fixed psi; psi-steps decrease Phi_psi at a fixed linearisation. Constraints
/// enter as errors of known size, which falls in stages until it no longer changes the estimate. Demanded exactly at
/// once they fail from most starts; in stages they succeed (Bock's and Baake's problems). Converged: the remaining full
/// step is shorter than `step_tolerance` in the metric of the posterior information, with the scales at their minimum.
/// (Then every parameter's step is below that many of its posterior sds, and the gradient is as small in the inverse
/// metric.) Where the objective has kinks (dry friction that begins to stick), the step is the one that decreases all
/// smooth pieces that meet there, see GradientBundle. A few more steps follow as long as they gain digits. If no
/// shorter step decreases Phi although its length is below `rounding_sds`, the residuals' own rounding is reached:
/// converged too, and the message says so. Otherwise no_progress.
/// @param begun  called once the start is evaluated; from then on no models::Stopped is thrown.
[[nodiscard]] Minimum minimise(const Problem& problem, const BlockSet& set, State& state, SolverStatistics& ledger,
                               const std::function<void()>& begun = {});

}  // namespace orbid::estimator
