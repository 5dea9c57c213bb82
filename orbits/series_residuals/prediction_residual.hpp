#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "estimator/interface/residual.hpp"
#include "models/system/system.hpp"
#include "orbits/simulation/transition.hpp"

namespace orbid::orbits {

struct PredictionOptions {
    std::string name = "prediction";  ///< prefix of group names: "prediction.phi"
    /// Sizes of the errors of the states relative to each other, shape (n), see error_sizes(); empty: 1 each.
    Eigen::VectorXd sizes;
    models::FlowOptions flow{1e-9, 1e-9, 20000};
    std::optional<Eigen::Index> delay = {};  ///< the parameter that delays the inputs, see predictions()
};

/// Prediction over one interval with the nodes pinned to the data: only parameters, no latent states, no trajectory
/// longer than an interval. The first stage, for starts far from the truth.
///
///     e = to - Phi(from; theta),  Cauchy errors of scale s d_i sqrt(0.01 + sum_j (X_ij d_j / d_i)^2),  d = sizes
///
/// The scale s is estimated, one per coordinate: the weight of a transition falls as errors of its start are amplified,
/// with X at the parameters of the last update_active_set(). Gross errors have little weight. Groups
/// "<name>.<coordinate>"; blocks of up to 64 transitions, as a block each would cost more than the flows. A transition
/// that cannot be simulated counts as off by its size at all parameters; a block in which most cannot fails.
///
/// The estimate is biased by the errors of the states (a frozen start instead of an estimated one): a good start, not a
/// result.
class PredictionResidual final : public estimator::Residual {
public:
    /// @param systems  one; of models with measured inputs one per segment of the series.
    /// @param start    the estimator's vector at the start, where amplifications are taken first.
    /// @throws DataError without transitions; std::invalid_argument on wrong shapes.
    PredictionResidual(std::vector<std::shared_ptr<const models::System>> systems, models::ParameterBinding binding,
                       std::vector<Transition> transitions, models::Clock clock, const Eigen::VectorXd& start,
                       PredictionOptions options = {});

    [[nodiscard]] std::string_view type() const override { return "prediction"; }
    [[nodiscard]] const std::vector<estimator::Group>& groups() const override { return initial_.groups; }
    [[nodiscard]] const std::vector<estimator::BlockLayout>& layout() const override { return initial_.layout; }
    [[nodiscard]] estimator::LatentStructure structure() const override { return estimator::LatentStructure::none; }
    [[nodiscard]] std::vector<Eigen::VectorXd> initial_latents() const override { return initial_.latents; }
    [[nodiscard]] estimator::ActiveSet initial_set() const override { return initial_; }
    [[nodiscard]] std::vector<estimator::BlockValue> evaluate(const estimator::ActiveSet& active,
                                                              const Eigen::VectorXd& theta,
                                                              const std::vector<Eigen::VectorXd>& latents,
                                                              bool derivatives) const override;
    /// Amplifications at theta, until they settle.
    estimator::RefreshReport update_active_set(estimator::ActiveSet& active, const Eigen::VectorXd& theta,
                                               const std::vector<Eigen::VectorXd>& latents,
                                               const Eigen::VectorXd& scales) const override;

    /// Robust measure of theta's prediction errors: mean over all records of ln(1 + (e / (0.02 sizes sqrt(..)))^2) with
    /// the amplifications at the start. A prediction far off counts little more than one slightly off, so that the
    /// minimum is broad and few transitions do not decide. One that cannot be made counts as off by its whole range.
    [[nodiscard]] double misfit(const Eigen::VectorXd& theta) const;

private:
    static constexpr std::size_t block_size = 64;

    /// Place of a coordinate of a transition among the records of its block.
    [[nodiscard]] Eigen::Index record(std::size_t transition, Eigen::Index coordinate) const {
        return static_cast<Eigen::Index>(transition % block_size) * options_.sizes.size() + coordinate;
    }
    /// Deviations of a set at theta: d_i sqrt(0.01 + ..) over d_i. @return the relative change of a weight in the
    /// median
    double amplify(estimator::ActiveSet& active, const Eigen::VectorXd& theta) const;

    std::vector<std::shared_ptr<const models::System>> systems_;
    models::ParameterBinding binding_;
    std::vector<Transition> transitions_;
    models::Clock clock_;
    PredictionOptions options_;
    estimator::ActiveSet initial_;  ///< memory: the number of updates
};

}  // namespace orbid::orbits
