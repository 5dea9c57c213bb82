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
/// Cycles of one map share its errors (Cycle::common). A block's errors are then those that remain when the blocks
/// before it have told what they can about them (CommonErrorFilter): the product over the blocks is the joint density
/// of all cycles. A factor s_g on the covariance multiplies what remains.
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
    [[nodiscard]] const std::vector<estimator::Group>& groups() const override { return initial_.groups; }
    [[nodiscard]] const std::vector<estimator::BlockLayout>& layout() const override { return initial_.layout; }
    [[nodiscard]] estimator::LatentStructure structure() const override { return estimator::LatentStructure::none; }
    [[nodiscard]] std::vector<estimator::JointCovariance> covariances() const override {
        return options_.targets.covariances;
    }
    [[nodiscard]] std::vector<Eigen::VectorXd> initial_latents() const override { return initial_.latents; }
    [[nodiscard]] estimator::ActiveSet initial_set() const override { return initial_; }
    [[nodiscard]] std::vector<estimator::BlockValue> evaluate(const estimator::ActiveSet& active,
                                                              const Eigen::VectorXd& theta,
                                                              const std::vector<Eigen::VectorXd>& latents,
                                                              bool derivatives) const override;
    estimator::RefreshReport update_active_set(estimator::ActiveSet& active, const Eigen::VectorXd& theta,
                                               const std::vector<Eigen::VectorXd>& latents,
                                               const Eigen::VectorXd& scales) const override;

    /// The computed orbits at theta, one per block (status says which were lost), with multipliers and sensitivities
    /// to the parameters of the binding. They start from the solutions that the set remembers.
    [[nodiscard]] std::vector<periodic::PeriodicOrbit> orbits(const estimator::ActiveSet& active,
                                                              const Eigen::VectorXd& theta) const;

    /// Of the points: those of the model, without that of the plane.
    [[nodiscard]] const std::vector<models::Coordinate>& coordinates() const { return map_.coordinates(); }

    /// Of the model at such points, shape (model's n, m).
    [[nodiscard]] Eigen::MatrixXd states(const Eigen::MatrixXd& points) const { return map_.states(points); }

    /// Index of a block's cycle in the list that was given.
    [[nodiscard]] std::size_t cycle_of(std::size_t block) const { return targets_.targets.at(block).cycle; }

    /// What a block is compared with.
    [[nodiscard]] const CycleTarget& target(std::size_t block) const { return targets_.targets.at(block); }

    /// Cycles left out because they are states of rest.
    [[nodiscard]] const std::vector<std::size_t>& at_rest() const { return targets_.at_rest; }

private:
    /// The last solution of a cycle, from which the next one starts. The memory of a set holds it, see known().
    struct Known {
        Eigen::MatrixXd nodes;          ///< shape (n, p)
        Eigen::VectorXd theta;          ///< the estimator's vector it belongs to; empty: only a guess
        Eigen::MatrixXd sensitivities;  ///< shape (n p, estimated)
        std::vector<int> rotation;
        bool multipliers = false;  ///< included in the layout
        int taken_back = 0;
    };
    /// Vectors in that memory for each cycle; after them one with what rejected_at_start() says. The last of a cycle is
    /// its gain (CommonErrorStep); empty: it tells nothing about the errors of others.
    static constexpr std::size_t memory_parts = 5;
    static constexpr std::size_t gain_part = 4;
    [[nodiscard]] Known known(const estimator::ActiveSet& active, std::size_t block) const;
    static void remember(estimator::ActiveSet& active, std::size_t block, const Known& known);
    [[nodiscard]] static bool has_multipliers(const estimator::ActiveSet& active, std::size_t block);
    [[nodiscard]] static double& taken_back(estimator::ActiveSet& active, std::size_t block);
    /// Gross errors at the start that are not reported yet.
    [[nodiscard]] static double& rejected_at_start(estimator::ActiveSet& active) { return active.memory.back()[0]; }

    [[nodiscard]] periodic::PeriodicOrbit solve(const estimator::ActiveSet& active, std::size_t block,
                                                const Eigen::VectorXd& theta, bool derivatives) const;
    void keep(estimator::ActiveSet& active, std::size_t block, const periodic::PeriodicOrbit& orbit,
              const Eigen::VectorXd& theta) const;
    /// Records of a block, with multipliers only where they are used now; empty when it cannot be evaluated.
    [[nodiscard]] std::optional<Eigen::VectorXd> residual(const estimator::ActiveSet& active, std::size_t block,
                                                          const periodic::PeriodicOrbit& orbit,
                                                          const PointReadings& readings) const;
    [[nodiscard]] std::optional<Eigen::VectorXd> residual(const estimator::ActiveSet& active, std::size_t block,
                                                          const periodic::PeriodicOrbit& orbit,
                                                          const Eigen::VectorXd& theta) const;
    [[nodiscard]] std::optional<Eigen::MatrixXd> derivative(const estimator::ActiveSet& active, std::size_t block,
                                                            const periodic::PeriodicOrbit& orbit,
                                                            const PointReadings& readings,
                                                            const Eigen::VectorXd& values) const;
    /// Rejects gross errors at the start, judged by positions alone.
    void gate_start(const std::vector<periodic::PeriodicOrbit>& solved, const Eigen::VectorXd& start);
    /// Lays out a block with or without its multipliers. @return whether any record is left.
    bool lay_out(estimator::ActiveSet& active, std::size_t block, const periodic::PeriodicOrbit& orbit) const;
    /// Covariance of a block's records by itself, and what they share with other cycles; both empty with equal weights,
    /// the latter also without common errors.
    [[nodiscard]] Eigen::MatrixXd own_shape(const estimator::ActiveSet& active, std::size_t block) const;
    [[nodiscard]] Eigen::MatrixXd own_common(const estimator::ActiveSet& active, std::size_t block) const;
    /// Shapes of all blocks, each given the active ones before it.
    void link(estimator::ActiveSet& active) const;
    /// Subtracts from the errors of all blocks what those before them tell.
    void subtract_known(const estimator::ActiveSet& active, std::vector<estimator::BlockValue>& values,
                        bool derivatives) const;
    [[nodiscard]] double mean_square(const estimator::ActiveSet& active, std::size_t block, const Eigen::VectorXd& e,
                                     const Eigen::VectorXd& scales) const;

    std::shared_ptr<const models::System> system_;
    models::ParameterBinding binding_;
    SectionMap map_;
    PointReading reading_;
    CycleResidualOptions options_;
    CycleTargets targets_;
    Eigen::VectorXd scale_;    ///< of the model's coordinates
    Eigen::Index shared_ = 0;  ///< columns of the errors that cycles share
    estimator::ActiveSet initial_;
};

}  // namespace orbid::orbits

#pragma GCC visibility pop
