#pragma once

#include <memory>
#include <vector>

#include "orbits/cycle_residuals/cycle_target.hpp"
#include "orbits/simulation/point_reading.hpp"

namespace orbid::orbits {

struct LiftedCycleOptions {
    CycleTargetOptions targets;  ///< multipliers do not take part, positions always do
    /// Of the matching conditions, with the matching sd as its scale. Student's t lets an orbit that is on the wrong
    /// branch of a fold, or wrong altogether, keep its defects without holding the others.
    estimator::ErrorDistribution matching = estimator::NormalErrors{};
    /// Of the whitened points. Student's t: a cycle matched to a wrong orbit does not hold the parameters.
    estimator::ErrorDistribution points = estimator::NormalErrors{};
    /// The matching sd as a share of scale(): at first (0: the defect that the measured points leave at the start),
    /// times `matching_factor` after every round, down to `matching_end`.
    double matching_start = 0.0;
    double matching_factor = 0.1;
    double matching_end = 1e-8;
    /// Continuity as equality constraints instead; the estimator approaches them in stages.
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
/// Angles wrapped, so that no rotation number is needed. A block per cycle; latent states in the order of points,
/// coordinate fastest. The matching sd falls from round to round (update_active_set()). Sets are intermediate stages
/// until it has reached its end: small against any point error, so that the nodes are orbits to all purposes.
class LiftedCycleResidual final : public estimator::Residual {
public:
    /// @param start        the estimator's vector at the start (to tell states of rest).
    /// @throws std::invalid_argument as select_targets, or for a schedule that does not fall to a value > 0.
    LiftedCycleResidual(std::shared_ptr<const models::System> system, models::ParameterBinding binding,
                        const std::vector<Cycle>& cycles, const SectionPlace& place, const Eigen::VectorXd& start,
                        const LiftedCycleOptions& options = {});

    [[nodiscard]] std::string_view type() const override { return "lifted_cycles"; }
    [[nodiscard]] const std::vector<estimator::Group>& groups() const override { return initial_.groups; }
    [[nodiscard]] const std::vector<estimator::BlockLayout>& layout() const override { return initial_.layout; }
    [[nodiscard]] estimator::LatentStructure structure() const override {
        return estimator::LatentStructure::independent_blocks;
    }
    [[nodiscard]] std::vector<Eigen::VectorXd> initial_latents() const override { return initial_.latents; }
    [[nodiscard]] estimator::ActiveSet initial_set() const override { return initial_; }
    [[nodiscard]] std::vector<estimator::BlockValue> evaluate(const estimator::ActiveSet& active,
                                                              const Eigen::VectorXd& theta,
                                                              const std::vector<Eigen::VectorXd>& latents,
                                                              bool derivatives) const override;
    /// The next matching sd.
    estimator::RefreshReport update_active_set(estimator::ActiveSet& active, const Eigen::VectorXd& theta,
                                               const std::vector<Eigen::VectorXd>& latents,
                                               const Eigen::VectorXd& scales) const override;

    /// Root mean square over all cycles of the matching defect z_{j+1} - Phi(z_j) per coordinate: shape (n).
    [[nodiscard]] Eigen::VectorXd matching_defect(const estimator::ActiveSet& active, const Eigen::VectorXd& theta,
                                                  const std::vector<Eigen::VectorXd>& latents) const;

    /// Typical size of each coordinate, see target_scale().
    [[nodiscard]] const Eigen::VectorXd& scale() const { return scale_; }

    /// How far the readings of each active cycle's nodes lie from its measured points: rms over all of them, as a share
    /// of scale(). Infinity where they cannot be had.
    [[nodiscard]] std::vector<double> distances(const estimator::ActiveSet& active, const Eigen::VectorXd& theta,
                                                const std::vector<Eigen::VectorXd>& latents) const;

    /// Nodes for CycleResidual: latent states by index into the list of cycles given, shape (n, p) each; empty for
    /// cycles that do not take part.
    [[nodiscard]] std::vector<Eigen::MatrixXd> nodes(const estimator::ActiveSet& active,
                                                     const std::vector<Eigen::VectorXd>& latents) const;

    /// Cycles left out because they are states of rest.
    [[nodiscard]] const std::vector<std::size_t>& at_rest() const { return targets_.at_rest; }

private:
    void match_with(estimator::ActiveSet& active, double matching) const;
    [[nodiscard]] bool evaluate_points(std::size_t block, const Eigen::MatrixXd& nodes, const Eigen::VectorXd& values,
                                       bool derivatives, estimator::BlockValue& value) const;

    std::shared_ptr<const models::System> system_;
    models::ParameterBinding binding_;
    SectionMap map_;
    PointReading reading_;
    LiftedCycleOptions options_;
    CycleTargets targets_;
    std::vector<Eigen::MatrixXd> roots_;  ///< L of each block's points
    Eigen::VectorXd scale_;
    std::size_t cycle_count_ = 0;
    estimator::ActiveSet initial_;  ///< memory: the matching sd as a share of scale_
};

}  // namespace orbid::orbits
