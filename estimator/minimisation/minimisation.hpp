#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "estimator/interface/not_finite.hpp"
#include "estimator/minimisation/constraint_stages.hpp"
#include "estimator/minimisation/error_updates.hpp"
#include "estimator/minimisation/excess_curvature.hpp"
#include "estimator/minimisation/minimum.hpp"
#include "estimator/minimisation/stopping.hpp"
#include "estimator/minimisation/trust_region.hpp"

namespace orbid::estimator {

/// One minimisation: the state, the quadratic model there, and the policies that decide how it goes on.
class Minimisation {
public:
    /// @param limited  see ConstraintStages
    Minimisation(const Problem& problem, const BlockSet& set, State& state, SolverStatistics& ledger, bool limited)
        : problem_(problem),
          set_(set),
          state_(state),
          ledger_(ledger),
          stages_(problem, set, state, limited),
          errors_(problem, set),
          stopping_(problem, set, ledger),
          excess_(problem, set),
          one_curvature_(has_one_curvature(set, problem.laws)) {}

    /// @param begun  see minimise()
    Minimum run(const std::function<void()>& begun);
    /// Whether run() gave up in a stage of loose constraints that did not settle.
    [[nodiscard]] bool unsettled() const { return stages_.unsettled(); }

private:
    /// A place to go to, and what it is worth.
    struct Trial {
        State state;
        PriorModel prior;
        Evaluation evaluation;
        double change = infinity;  ///< of the objective
        double gain = -infinity;   ///< actual over predicted decrease
        double curvature = -1.0;   ///< true second derivative along the step
        double keep = 0.25;        ///< share of the step to keep after a rejection
        StepRejection reason = StepRejection::none;
        bool slopes_compared = false;
    };

    bool start(const std::function<void()>& begun);
    bool go_on();
    bool after_step();
    bool update_errors();
    void tighten();
    void rescale(const std::function<void()>& change);
    void search_errors(Follow follow);
    bool settle_errors();
    void factorise_errors();
    void factorise_steps();
    void take_factor(WhitenedArrow standard);
    void drop_factors();
    void set_model();
    const TrialStep& full_step();
    [[nodiscard]] double initial_radius() const;
    [[nodiscard]] Standing standing();
    [[nodiscard]] double objective() const;
    [[nodiscard]] double misfit() const;
    bool try_step(const TrialStep& step);
    [[nodiscard]] State moved(const TrialStep& step) const;
    [[nodiscard]] Trial evaluated(const TrialStep& step);
    void compare_slopes(const TrialStep& step, Trial& trial) const;
    [[nodiscard]] bool judged_by_gradients(double curvature) const;
    [[nodiscard]] bool decreases(Trial& trial);
    void adopt(const TrialStep& step, Trial trial, double misfit);
    bool end_at(std::vector<std::size_t> stopped);
    [[nodiscard]] std::vector<std::size_t> few_that_move();
    bool hold_few();
    bool release_held();
    /// What is found where no step decreases the objective: no kink, one that a step leads away from, or the minimum.
    enum class Kink { none, left, minimum };
    [[nodiscard]] Eigen::Index unknowns() const;
    [[nodiscard]] TrialStep step_of(const Eigen::VectorXd& p);
    [[nodiscard]] Eigen::VectorXd gradient_of(const std::vector<BlockRows>& rows, const PriorModel& prior);
    [[nodiscard]] Eigen::MatrixXd hessian();
    bool step_along_kink(const TrialStep& step);
    Kink examine_kink();
    Kink examine_jump(const TrialStep& step);
    bool passes_kink();
    void conclude(Outcome outcome, const std::string& message) {
        minimum_.outcome = outcome;
        minimum_.message = message;
    }
    /// Intermediate stages start far out: their steps are never longer than far records can bear.
    [[nodiscard]] Curvature curvature() const { return set_.provisional ? Curvature::guarded : Curvature::step; }

    const Problem& problem_;
    const BlockSet& set_;
    State& state_;
    SolverStatistics& ledger_;
    ConstraintStages stages_;
    ErrorUpdates errors_;
    Stopping stopping_;
    ExcessCurvature excess_;

    Minimum minimum_;
    /// Whether errors ask for the same rows in steps and in expectation: a search over their parameters then begins
    /// and ends with rows that are factorised for steps as well.
    bool one_curvature_;
    WhitenedArrow standard_;  ///< at the state; its value is -ln p of the errors without ln|Sigma|
    ReducedProblem reduced_;  ///< of it, undamped
    StepModel model_;
    std::optional<TrialStep> full_;  ///< the full step of the model, once asked for
    double model_length_ = 0.0;      ///< of the full step of the parameters, in posterior sds
    StepTaken last_;
    double stretch_ = 1.0;  ///< length of the best step over the full Gauss-Newton step, from the last full step
    double radius_ = 0.0;
    bool derivatives_at_trial_ = true;
    int kinks_ = 0;          ///< examined
    bool released_ = false;  ///< blocks that were held move again
    std::string held_message_;
};

}  // namespace orbid::estimator
