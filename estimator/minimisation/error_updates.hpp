#pragma once

#include <optional>
#include <string>

#include <Eigen/Core>

#include "estimator/minimisation/error_limits.hpp"
#include "estimator/minimisation/minimum.hpp"
#include "estimator/minimisation/step_rules.hpp"

namespace orbid::estimator {

/// How error parameters change between the steps of theta.
class ErrorUpdates {
public:
    /// Whether they are searched at a point, and how.
    struct Decision {
        bool search = false;
        std::string refusal;  ///< why they cannot be estimated; empty: they can
        Follow follow = Follow::latents;
    };

    ErrorUpdates(const Problem& problem, const BlockSet& set) : problem_(problem), set_(set) {}

    /// Scales without a start. Where states start on their readings and are held together loosely, the readings' errors
    /// are those that the gaps ask for. Only the ratio to the continuity sd matters, which the stages go through.
    void start(const Minimum& minimum, State& state, int round);
    /// psi after one step of expectation and maximisation per intermediate stage: s^2 = [e^T e + tr(J C J^T)] / n of
    /// (M10), for scales without a start. Where continuity is loose the data do not determine them and they stay. They
    /// approach their own values as it tightens. At their minimum they would go to zero instead, for loose continuity
    /// alone can explain everything.
    [[nodiscard]] Eigen::VectorXd followed(const Minimum& minimum, const State& state, int round) const;
    [[nodiscard]] Decision decide(const Minimum& minimum, const BlockArrow& arrow, const Eigen::VectorXd& psi,
                                  const StepTaken& last) const;
    /// psi at the minimum of Phi_psi. It is noted in the history and in the limits of `minimum`. Where a step of the
    /// parameters follows anyway, psi may be where it is only nearly there, and go on with that step, see take_due().
    /// @param length    of the full step of the parameters, in posterior sds
    /// @param standard  what is factorised at the state already, see evaluate_errors(); becomes that of the psi found
    [[nodiscard]] Eigen::VectorXd searched(Follow follow, double length, const State& state, Minimum& minimum,
                                           SolverStatistics& ledger, std::optional<WhitenedArrow>& standard);
    /// Why a full covariance cannot be estimated; empty when it can.
    [[nodiscard]] std::string refusal(const Minimum& minimum, const Eigen::VectorXd& psi) const {
        return why_no_covariance(problem_, set_, psi, minimum.step.space.data.cols());
    }
    /// Moves psi to where it goes with a step of the parameters. @return whether that is elsewhere
    bool take_due(Eigen::VectorXd& psi);
    /// The weight of constraints changed: what was learned about curvature is no longer valid.
    void forget_curvature() { curvature_ = {}; }
    /// See ErrorLimits, at the last search.
    [[nodiscard]] double rounding() const { return rounding_; }

private:
    const Problem& problem_;
    const BlockSet& set_;
    Eigen::VectorXd latent_fit_;  ///< see latent_fit_sizes(), at the start
    ErrorCurvature curvature_;
    Eigen::VectorXd due_;  ///< psi after the next step; empty: it stays
    double rounding_ = 0.0;
};

}  // namespace orbid::estimator
