#pragma once

#include <algorithm>

#include <Eigen/Core>

#include "estimator/minimisation/step_rules.hpp"
#include "estimator/problem/problem.hpp"

namespace orbid::estimator {

/// The stages in which constraints tighten, and the limits of parameters meanwhile.
///
/// Violations fall tenfold from stage to stage, down to a fraction of their sizes that changes no estimate. The
/// information from data with errors of a ten-thousandth is still 1e5 times looser.
class ConstraintStages {
public:
    /// @param limited  parameters keep within their own size of the start until the constraints are tight
    ConstraintStages(const Problem& problem, const BlockSet& set, const State& start, bool limited)
        : problem_(problem),
          constrained_(set.constraints > 0),
          limited_(limited),
          lower_(problem.lower),
          upper_(problem.upper) {
        if (!limited) return;
        const Eigen::VectorXd size = sizes(problem, start.theta);
        lower_ = lower_.cwiseMax(start.u - size);
        upper_ = upper_.cwiseMin(start.u + size);
    }

    /// Weight of the first stage: constraints are as loose as they are violated.
    [[nodiscard]] static double first(double violation) { return std::clamp(violation, exact, 1e6); }
    /// Whether a stage follows the one with this weight.
    [[nodiscard]] bool left(double matching) const { return constrained_ && matching > exact; }
    /// Whether the next stage begins after this step: when this one has little left to give. Short steps do not show
    /// how far it is from its end.
    [[nodiscard]] bool decide(const StepTaken& step, double matching) const {
        return left(matching) && step.full && step.decrease < 0.05 * step.misfit;
    }
    /// Begins the next stage. @return its weight
    [[nodiscard]] double begin_next(double matching) {
        matching = std::max(exact, 0.1 * matching);
        trials_ = 0;
        if (matching < tight) {
            lower_ = problem_.lower;
            upper_ = problem_.upper;
        }
        return matching;
    }
    void count_trial(double matching) {
        if (left(matching)) ++trials_;
    }
    /// Whether a stage did not settle. Loose ones settle within a dozen steps, or parameters run along a valley to
    /// infinity. The minimisation is then restarted with limited parameters.
    [[nodiscard]] bool unsettled() const { return !limited_ && trials_ > 20; }

    [[nodiscard]] const Eigen::VectorXd& lower() const { return lower_; }  ///< of u
    [[nodiscard]] const Eigen::VectorXd& upper() const { return upper_; }

private:
    static constexpr double exact = 1e-9;
    static constexpr double tight = 1e-3;  ///< violations this small lift the limits of parameters

    const Problem& problem_;
    bool constrained_;
    bool limited_;
    Eigen::VectorXd lower_;
    Eigen::VectorXd upper_;
    int trials_ = 0;  ///< in the present stage
};

}  // namespace orbid::estimator
