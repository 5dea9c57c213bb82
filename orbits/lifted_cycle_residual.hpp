#pragma once

#include <memory>
#include <vector>

#include "orbits/cycle_target.hpp"
#include "orbits/point_reading.hpp"

namespace orbid::orbits {

struct LiftedCycleOptions {
    CycleTargetOptions targets;  ///< multipliers do not take part, positions always do
    /// Of the matching conditions, with the matching sd as its scale. Student's t lets an orbit that is on the wrong
    /// branch of a fold, or wrong altogether, keep its defects without holding the others.
    estimator::ErrorDistribution matching = estimator::NormalErrors{};
    /// Matching as equality constraints instead; the estimator approaches them in stages.
    bool exact = false;
    /// 1e-11: the matching conditions are as exact as their sd, and the reduced residual has the last word.
    models::FlowOptions flow{1e-11, 1e-11, 20000};
};

/// Orbits and parameters improved together: the points of a cycle are latent states.
///
///     e = L^-1 (y_j - sensor(z_j; theta))     group "cycles.points", sd 1, L L^T = D Sigma_c D
///     e = z_{j+1} - Phi(z_j; theta), j mod p  groups "matching.<coordinate>", fixed sd; or c = 0
///
/// The scales D of the points are fixed (factor 1, the analysis' own covariance; weights "equal": 1e-3 of the range;
/// or as the options fix them): beside a wide matching sd an estimated one runs to zero, the nodes then stay on the
/// measured points, and the stage improves nothing.
///
/// Angles wrapped, so that no rotation number is needed. The caller lowers the matching sd in stages, each started from
/// the latent states of the one before. A block per cycle; latent states in the order of points, coordinate fastest.
class LiftedCycleResidual final : public estimator::Residual {
public:
    /// @param start        the estimator's vector at the start (to tell states of rest).
    /// @param matching_sd  one per coordinate, in its unit, > 0; the sizes of the constraints when they are exact.
    /// @throws std::invalid_argument as select_targets, or for a matching sd that is missing or not > 0.
    LiftedCycleResidual(std::shared_ptr<const models::System> system, models::ParameterBinding binding,
                        const std::vector<Cycle>& cycles, double phase, const Eigen::VectorXd& start,
                        const Eigen::VectorXd& matching_sd, const LiftedCycleOptions& options = {});

    /// The same residual with another matching sd, started from these latent states (empty: the measured points).
    [[nodiscard]] LiftedCycleResidual tightened(const Eigen::VectorXd& matching_sd,
                                                std::vector<Eigen::VectorXd> latents) const;

    [[nodiscard]] std::string_view type() const override { return "lifted_cycles"; }
    [[nodiscard]] const std::vector<estimator::Group>& groups() const override { return groups_; }
    [[nodiscard]] const std::vector<estimator::BlockLayout>& layout() const override { return layout_; }
    [[nodiscard]] estimator::LatentStructure structure() const override {
        return estimator::LatentStructure::independent_blocks;
    }
    [[nodiscard]] std::vector<Eigen::VectorXd> initial_latents() const override { return start_; }
    [[nodiscard]] std::vector<estimator::BlockValue> evaluate(const Eigen::VectorXd& theta,
                                                              const std::vector<Eigen::VectorXd>& latents,
                                                              bool derivatives) const override;
    /// Nothing changes between minimisations.
    estimator::RefreshReport refresh(const Eigen::VectorXd&, const std::vector<Eigen::VectorXd>&,
                                     const Eigen::VectorXd&) override {
        return {};
    }
    void suspend(std::size_t block) override { layout_.at(block).active = false; }

    /// Root mean square over all cycles of the matching defect z_{j+1} - Phi(z_j) per coordinate: shape (n); the first
    /// stage's matching sd when z are the measured points and theta the estimate of the one-period prediction.
    [[nodiscard]] Eigen::VectorXd matching_defect(const Eigen::VectorXd& theta,
                                                  const std::vector<Eigen::VectorXd>& latents) const;

    /// Nodes for CycleResidual: latent states by index into the list of cycles given, shape (n, p) each; empty for
    /// cycles that do not take part.
    [[nodiscard]] std::vector<Eigen::MatrixXd> nodes(const std::vector<Eigen::VectorXd>& latents) const;

    /// Cycles left out because they are states of rest.
    [[nodiscard]] const std::vector<std::size_t>& at_rest() const { return targets_.at_rest; }

private:
    void match_with(const Eigen::VectorXd& matching_sd);
    [[nodiscard]] bool evaluate_points(std::size_t block, const Eigen::MatrixXd& nodes, const Eigen::VectorXd& values,
                                       bool derivatives, estimator::BlockValue& value) const;

    std::shared_ptr<const models::System> system_;
    models::ParameterBinding binding_;
    SectionMap map_;
    PointReading reading_;
    bool exact_ = false;
    CycleTargets targets_;
    std::vector<Eigen::MatrixXd> roots_;  ///< L of each block's points
    std::size_t cycle_count_ = 0;
    std::vector<estimator::Group> groups_;
    std::vector<estimator::BlockLayout> layout_;
    std::vector<Eigen::VectorXd> start_;
};

}  // namespace orbid::orbits
