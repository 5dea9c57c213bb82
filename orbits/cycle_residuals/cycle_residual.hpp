#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "orbits/cycle_residuals/cycle_target.hpp"
#include "orbits/simulation/point_reading.hpp"
#include "periodic/orbit/orbit.hpp"

#pragma GCC visibility push(default)

namespace orbid::orbits {

struct CycleResidualOptions {
    CycleTargetOptions targets;
    /// Largest distance of a solved orbit from where it was expected, relative to the range of the coordinates, > 0.
    /// Beyond it lies another orbit, and the cycle counts as lost.
    double maximum_move = 0.05;
    /// A cycle is a gross error when its mean squared whitened residual exceeds this many times the median over all
    /// cycles: 25 = five times the usual error. > 1; infinity: no gate.
    double gate = 25.0;
    /// 1e-12: errors of measured points can be as small as 1e-8, and predictions must be more accurate.
    models::FlowOptions flow{1e-12, 1e-12, 20000};
};

/// Measured cycles against re-solved periodic orbits of the model: no latent states, for the final estimate.
///
///     e_c = (y_c - sensor(x_c(theta)),  ln|mu|_c - ln|mu_c(theta)|,  T_c - T_c(theta)),   V_c = D Sigma_c D
///
/// x_c moves by (M7), ln|mu_c| by second variational equations (periodic::stability). One block per cycle. Its records
/// are the points in order, coordinate fastest, then the multipliers, largest modulus first, then T. Groups are
/// "cycles.<coordinate>", "cycles.ln_multiplier", "cycles.time". Sigma_c correlates points with points and multipliers
/// with multipliers.
/// Each orbit is solved by multiple shooting, started from the last solution, which its sensitivities move to first
/// order. An orbit that does not converge, or converges elsewhere, is missing data (BlockStatus::failed).
///
/// An orbit with a period of sticking has a multiplier 0, which has no logarithm: its block then has no multipliers.
///
/// Start nodes come from stages that wrong cycles did not affect. With them, gross errors are visible at once and are
/// rejected before the first step.
///
/// update_active_set(): moves the solutions to the present theta and rejects gross errors (see `gate`). Lost cycles
/// whose orbit is found again are restored, at most twice each.
class CycleResidual final : public estimator::Residual {
public:
    /// @param start        the estimator's vector at the start.
    /// @param start_nodes  first guess per measured cycle, shape (n, p) each, as LiftedCycleResidual::nodes. An empty
    ///                     list or entry: the measured points.
    /// @throws std::invalid_argument as select_targets; nodes of the wrong shape; options out of range.
    CycleResidual(std::shared_ptr<const models::System> system, models::ParameterBinding binding,
                  const std::vector<Cycle>& cycles, const SectionPlace& place, const Eigen::VectorXd& start,
                  const std::vector<Eigen::MatrixXd>& start_nodes = {}, const CycleResidualOptions& options = {});

    [[nodiscard]] std::string_view type() const override { return "cycles"; }
    [[nodiscard]] const std::vector<estimator::Group>& groups() const override { return groups_; }
    [[nodiscard]] const std::vector<estimator::BlockLayout>& layout() const override { return layout_; }
    [[nodiscard]] estimator::LatentStructure structure() const override { return estimator::LatentStructure::none; }
    [[nodiscard]] std::vector<estimator::JointCovariance> covariances() const override {
        return options_.targets.covariances;
    }
    [[nodiscard]] std::vector<Eigen::VectorXd> initial_latents() const override;
    [[nodiscard]] std::vector<estimator::BlockValue> evaluate(const Eigen::VectorXd& theta,
                                                              const std::vector<Eigen::VectorXd>& latents,
                                                              bool derivatives) const override;
    estimator::RefreshReport update_active_set(const Eigen::VectorXd& theta,
                                               const std::vector<Eigen::VectorXd>& latents,
                                               const Eigen::VectorXd& scales) override;
    void deactivate(std::size_t block) override { layout_.at(block).active = false; }

    /// The computed orbits at theta, one per block (status says which were lost), with multipliers and sensitivities
    /// to the parameters of the binding.
    [[nodiscard]] std::vector<periodic::PeriodicOrbit> orbits(const Eigen::VectorXd& theta) const;

    /// Index of a block's cycle in the list that was given.
    [[nodiscard]] std::size_t cycle_of(std::size_t block) const { return targets_.targets.at(block).cycle; }

    /// What a block is compared with.
    [[nodiscard]] const CycleTarget& target(std::size_t block) const { return targets_.targets.at(block); }

    /// Cycles left out because they are states of rest.
    [[nodiscard]] const std::vector<std::size_t>& at_rest() const { return targets_.at_rest; }

private:
    /// The last solution of a cycle, from which the next one starts.
    struct Known {
        Eigen::MatrixXd nodes;          ///< shape (n, p)
        Eigen::VectorXd theta;          ///< the estimator's vector it belongs to; empty: only a guess
        Eigen::MatrixXd sensitivities;  ///< shape (n p, estimated)
        std::vector<int> rotation;
        bool multipliers = false;  ///< included in the layout
        int taken_back = 0;
    };

    [[nodiscard]] periodic::PeriodicOrbit solve(std::size_t block, const Eigen::VectorXd& theta,
                                                bool derivatives) const;
    void keep(std::size_t block, const periodic::PeriodicOrbit& orbit, const Eigen::VectorXd& theta);
    /// Records of a block, with multipliers only where they are used now; empty when it cannot be evaluated.
    [[nodiscard]] std::optional<Eigen::VectorXd> residual(std::size_t block, const periodic::PeriodicOrbit& orbit,
                                                          const PointReadings& readings) const;
    [[nodiscard]] std::optional<Eigen::VectorXd> residual(std::size_t block, const periodic::PeriodicOrbit& orbit,
                                                          const Eigen::VectorXd& theta) const;
    [[nodiscard]] std::optional<Eigen::MatrixXd> derivative(std::size_t block, const periodic::PeriodicOrbit& orbit,
                                                            const PointReadings& readings,
                                                            const Eigen::VectorXd& values) const;
    /// Rejects gross errors at the start, judged by positions alone.
    void gate_start(const std::vector<periodic::PeriodicOrbit>& solved, const Eigen::VectorXd& start);
    /// Lays out a block with or without its multipliers. @return whether any record is left.
    bool lay_out(std::size_t block, const periodic::PeriodicOrbit& orbit);
    [[nodiscard]] double mean_square(std::size_t block, const Eigen::VectorXd& e, const Eigen::VectorXd& scales) const;

    std::shared_ptr<const models::System> system_;
    models::ParameterBinding binding_;
    SectionMap map_;
    PointReading reading_;
    CycleResidualOptions options_;
    CycleTargets targets_;
    Eigen::VectorXd scale_;  ///< of the model's coordinates
    std::vector<estimator::Group> groups_;
    std::vector<estimator::BlockLayout> layout_;
    std::vector<Known> known_;
    int rejected_at_start_ = 0;  ///< not reported yet
};

}  // namespace orbid::orbits

#pragma GCC visibility pop
