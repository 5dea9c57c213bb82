#pragma once

#include <vector>

#include <Eigen/Core>

#include "estimator/interface/residual.hpp"

namespace orbid::estimator {

/// A residual with other records: y + shift in place of y, so that e(theta, z) + shift.
///
/// Blocks, latent states and error parameters begin where an estimate has ended, and the set of blocks stays that of
/// the estimate.
class RedrawnResidual final : public Residual {
public:
    /// @param inner   not owned.
    /// @param begin   of the estimate: its set, with latent states and error parameters to begin with.
    /// @param shifts  one per block, shape (records); empty where the block is not active.
    RedrawnResidual(const Residual& inner, ActiveSet begin, std::vector<Eigen::VectorXd> shifts);

    [[nodiscard]] std::string_view type() const override { return inner_.type(); }
    [[nodiscard]] const std::vector<Group>& groups() const override { return initial_.groups; }
    [[nodiscard]] const std::vector<BlockLayout>& layout() const override { return initial_.layout; }
    [[nodiscard]] LatentStructure structure() const override { return inner_.structure(); }
    [[nodiscard]] std::vector<JointCovariance> covariances() const override { return inner_.covariances(); }
    [[nodiscard]] std::vector<Eigen::VectorXd> initial_latents() const override { return initial_.latents; }
    [[nodiscard]] ActiveSet initial_set() const override { return initial_; }
    [[nodiscard]] std::vector<BlockValue> evaluate(const ActiveSet& active, const Eigen::VectorXd& theta,
                                                   const std::vector<Eigen::VectorXd>& latents,
                                                   bool derivatives) const override;

private:
    const Residual& inner_;
    std::vector<Eigen::VectorXd> shifts_;
    ActiveSet initial_;
};

}  // namespace orbid::estimator
