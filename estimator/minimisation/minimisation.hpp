#pragma once

#include <cstddef>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include <Eigen/Core>

#include "estimator/interface/not_finite.hpp"
#include "estimator/minimisation/error_limits.hpp"
#include "estimator/minimisation/minimum.hpp"
#include "estimator/minimisation/trust_region.hpp"

namespace orbid::estimator {

/// Violations of constraints fall by this factor from stage to stage, down to a fraction of their sizes that changes no
/// estimate. The information from data with errors of a ten-thousandth is still 1e5 times looser.
inline constexpr double tightening = 0.1;
inline constexpr double exact_matching = 1e-9;

/// Stages of loose constraints settle within a dozen steps, or parameters run along a valley to infinity. The
/// minimisation is then restarted with parameters kept within their own size of the start until violations are this
/// small.
inline constexpr int stage_limit = 20;
inline constexpr double tight_matching = 1e-3;

/// One minimisation: the state and everything derived from it at the present point.
class Minimisation {
public:
    /// @param limited  parameters keep within their own size of the start until the constraints are tight
    Minimisation(const Problem& problem, const BlockSet& set, State& state, SolverStatistics& ledger, bool limited)
        : problem_(problem),
          set_(set),
          state_(state),
          ledger_(ledger),
          failures_(set.blocks.size(), 0),
          cut_(set.blocks.size(), false),
          limited_(limited),
          lower_(problem.lower),
          upper_(problem.upper) {
        if (!limited) return;
        const Eigen::VectorXd size = sizes(problem, state.theta);
        lower_ = lower_.cwiseMax(state.u - size);
        upper_ = upper_.cwiseMin(state.u + size);
    }

    Minimum run();
    /// Whether run() gave up in a stage of loose constraints that did not settle.
    [[nodiscard]] bool unsettled() const { return !limited_ && stage_trials_ > stage_limit; }

private:
    /// How the steps of a stage go.
    struct Pace {
        int rejected = 0;         ///< trials in a row
        int polishing = 0;        ///< steps since the convergence test is met
        int stagnant = 0;         ///< steps without halving what is left
        double last = infinity;   ///< what was left before the last step
        double least = infinity;  ///< the least that was left when it was last halved
    };
    /// A place to go to, and what it is worth.
    struct Trial {
        State state;
        PriorModel prior;
        Evaluation evaluation;
        std::vector<BlockRows> rows;  ///< linearisation there, if it was needed
        double change = infinity;     ///< of the objective
        double curvature = -1.0;      ///< true second derivative along the step
        double keep = 0.25;           ///< share of the step to keep after a rejection
        std::string_view reason;      ///< why it is rejected
    };
    enum class Next { step, stage, end };

    bool start();
    void start_errors();
    bool update_errors(bool profile);
    [[nodiscard]] ErrorLimits limits() const {
        return error_limits(problem_, set_, state_, minimum_.rows, latent_fit_);
    }
    void rescale(const std::function<void()>& change);
    bool tighten(bool at_once);
    bool without_covariance();
    [[nodiscard]] double initial_radius() const;
    void factorise_errors();
    void set_model();
    const TrialStep& full_step();
    void follow_scales();
    void note_remaining();
    [[nodiscard]] Next decide();
    [[nodiscard]] bool gains_no_digits() const;
    [[nodiscard]] bool within_rounding() const;
    [[nodiscard]] bool exhausted() const;
    void conclude(Outcome outcome, const std::string& message) {
        minimum_.outcome = outcome;
        minimum_.message = message;
    }
    bool go_on();
    bool after_step();
    bool try_step(const TrialStep& step);
    [[nodiscard]] State moved(const TrialStep& step) const;
    [[nodiscard]] Trial evaluated(const TrialStep& step);
    void compare_slopes(const TrialStep& step, Trial& trial);
    [[nodiscard]] bool decreases(Trial& trial);
    void adopt(const TrialStep& step, Trial trial);
    bool stopped_blocks(const std::function<bool(std::size_t)>& rule);
    [[nodiscard]] double objective() const;
    /// Intermediate stages start far out: their steps are never longer than far records can bear.
    [[nodiscard]] Curvature curvature() const { return set_.provisional ? Curvature::guarded : Curvature::step; }
    /// Half the sum of squares of whitened residuals and constraints.
    [[nodiscard]] double misfit() const {
        double square = 0.0;
        for (const BlockTriangle& block : arrow_.blocks) {
            square += block.triangle.rightCols(1).squaredNorm();
            if (block.link.size() > 0) square += block.link.rightCols(1).squaredNorm();
        }
        return 0.5 * square;
    }

    const Problem& problem_;
    const BlockSet& set_;
    State& state_;
    SolverStatistics& ledger_;
    Minimum minimum_;
    BlockArrow arrow_;
    double value_ = 0.0;  ///< -ln p of the errors at the state, without ln|Sigma|
    StepModel model_;
    TrialStep full_;  ///< the full step of the model, once asked for
    bool full_known_ = false;
    double model_length_ = 0.0;  ///< of the full step of the parameters, in posterior sds
    ErrorCurvature curvature_;   ///< of the error parameters, as last seen
    std::vector<int> failures_;  ///< steps in a row that had to be shortened because of each block
    std::vector<bool> cut_;      ///< blocks that failed at a trial of the present step
    bool limited_;
    Eigen::VectorXd lower_;  ///< of u, move limits included
    Eigen::VectorXd upper_;
    Pace pace_;
    int accepted_ = 0;
    int stage_trials_ = 0;  ///< in the present stage of loose constraints
    double stretch_ = 1.0;  ///< length of the best step over the full Gauss-Newton step, from the last full step
    double radius_ = 0.0;
    Eigen::VectorXd latent_fit_;  ///< see latent_fit_sizes(), at the start
    double rounding_ = 0.0;  ///< least change that residuals can show, in sds of the errors: the largest of all scales
    bool derivatives_at_trial_ = true;
    double last_decrease_ = 0.0;   ///< of the last accepted step
    double last_objective_ = 0.0;  ///< sum of squares before it, for the stages of constraints
    double gain_ = 0.0;            ///< actual over predicted decrease of the last step
    bool last_step_full_ = false;
};

}  // namespace orbid::estimator
