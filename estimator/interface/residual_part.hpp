#pragma once

#include <cstddef>

#include "estimator/interface/chain_share.hpp"
#include "estimator/interface/residual.hpp"

namespace orbid::estimator {

/// Some successive blocks of another residual, as one of several ranks has them. The other one is known as a whole on
/// every rank (its data and layout), but its blocks are evaluated on their own rank only, and only they are in the
/// estimate there. Where the last block is linked to the one after it, that one is here as well, see ChainShare.
class ResidualPart final : public Residual {
public:
    /// Blocks [begin, end) of `whole`, which must outlive this.
    /// @throws std::invalid_argument for an empty range, blocks that do not exist, links to a block that is not the
    ///         following one.
    ResidualPart(const Residual& whole, std::size_t begin, std::size_t end);

    /// The part of one of several ranks, all of about the same number of blocks, each of two or more.
    /// @throws std::invalid_argument when there are too few blocks.
    [[nodiscard]] static ResidualPart of_rank(const Residual& whole, int rank, int count);

    [[nodiscard]] const ChainShare& share() const { return share_; }
    [[nodiscard]] std::size_t begin() const { return begin_; }
    [[nodiscard]] std::size_t end() const { return end_; }

    [[nodiscard]] std::string_view type() const override { return whole_.type(); }
    [[nodiscard]] const std::vector<Group>& groups() const override { return whole_.groups(); }
    [[nodiscard]] const std::vector<BlockLayout>& layout() const override { return initial_.layout; }
    [[nodiscard]] LatentStructure structure() const override { return whole_.structure(); }
    [[nodiscard]] std::vector<JointCovariance> covariances() const override { return whole_.covariances(); }
    [[nodiscard]] std::vector<Eigen::VectorXd> initial_latents() const override { return initial_.latents; }
    [[nodiscard]] ActiveSet initial_set() const override { return initial_; }
    [[nodiscard]] std::vector<BlockValue> evaluate(const ActiveSet& active, const Eigen::VectorXd& theta,
                                                   const std::vector<Eigen::VectorXd>& latents,
                                                   bool derivatives) const override;
    /// The other residual decides with the blocks of this part alone active.
    RefreshReport update_active_set(ActiveSet& active, const Eigen::VectorXd& theta,
                                    const std::vector<Eigen::VectorXd>& latents,
                                    const Eigen::VectorXd& scales) const override;

private:
    [[nodiscard]] ActiveSet whole_set(const ActiveSet& active) const;
    [[nodiscard]] std::vector<Eigen::VectorXd> whole_latents(const std::vector<Eigen::VectorXd>& latents) const;

    const Residual& whole_;
    std::size_t begin_;
    std::size_t end_;
    ChainShare share_;
    ActiveSet initial_;    ///< of this part
    ActiveSet whole_set_;  ///< of the other residual, all other blocks inactive
};

}  // namespace orbid::estimator
