#pragma once

#include <vector>

#include <Eigen/Core>

#include "estimator/algebra/block_arrow.hpp"
#include "estimator/problem/block_set.hpp"
#include "estimator/problem/coordinate.hpp"

namespace orbid::estimator {

/// Rows of one law in one block.
struct PartRows {
    std::size_t law = 0;
    LawRecords records;
};

/// Rows [de/dz | de/du | e] of one block, not yet divided by the errors, sorted by error law.
///
/// Where a law depends on sums of squares only, its rows are replaced by their R factor. All sums of squares and
/// products stay the same, and so does everything (M8)-(M11) needs of them for any error scale. The cost no longer
/// depends on the number of records.
struct BlockRows {
    std::vector<PartRows> parts;
    /// Records that depend on the latent states of the block `next` as well: rows [de/dz | de/dz_next | de/du | e].
    std::vector<PartRows> linked_parts;
    /// With a covariance shape: all rows, shape (rows, latents + columns + 1), and the channel of each.
    Eigen::MatrixXd rows;
    std::vector<int> channel;
    Eigen::Index latents = 0;
    Eigen::Index next_latents = 0;              ///< of the block `next`
    const Eigen::MatrixXd* cholesky = nullptr;  ///< of the covariance shape, empty = identity; owned by the BlockSet
    /// Constraints divided by their sizes, [c_z | c_next | c_u | c], and the block that z_next belongs to.
    Eigen::MatrixXd link;
    std::ptrdiff_t next = -1;
    /// Curvature that steps see beyond that of the rows, over the square of the own columns' lengths. Blocks in chains.
    double excess = 0.0;
};

/// Rows of all active blocks at theta (natural units), derivatives with respect to the coordinates u. Compressed unless
/// told otherwise (clusters of records need them all).
[[nodiscard]] std::vector<BlockRows> linearise(const BlockSet& set, const std::vector<NoiseModel>& laws,
                                               const std::vector<BlockValue>& values,
                                               const std::vector<Coordinate>& coordinates, const Eigen::VectorXd& theta,
                                               bool compressed = true);

/// The same rows in other parameters y, u = u_0 + basis y: shape of basis (parameters, columns).
[[nodiscard]] std::vector<BlockRows> in_basis(const std::vector<BlockRows>& rows, const Eigen::MatrixXd& basis);

/// One block's rows divided by the errors (without constraints and linked records), and -ln p of its records without
/// ln|Sigma_b| and known sds.
[[nodiscard]] WhitenedRows standard_rows(const BlockRows& block, const std::vector<NoiseModel>& laws,
                                         const Eigen::VectorXd& psi, Curvature curvature);
/// The same for some parts only, for instance BlockRows::linked_parts.
[[nodiscard]] WhitenedRows standard_rows(const std::vector<PartRows>& parts, const std::vector<NoiseModel>& laws,
                                         const Eigen::VectorXd& psi, Curvature curvature);

/// Derivative of standard_rows() of a block, or of these parts of it, with respect to psi[k]; rows that do not depend
/// on it are zero.
[[nodiscard]] WhitenedRows standard_rows_derivative(const BlockRows& block, const std::vector<PartRows>& parts,
                                                    const std::vector<NoiseModel>& laws, const Eigen::VectorXd& psi,
                                                    Eigen::Index k, Curvature curvature, const WhitenedRows& at);

/// What divides rows: the error parameters, the weight of constraints, and which second derivative is meant.
struct ErrorWeights {
    const Eigen::VectorXd& psi;
    double matching = 1.0;
    Curvature curvature = Curvature::step;
};

/// A direction of parameters (in u) and latent states, one vector per active block.
struct Direction {
    const Eigen::VectorXd& parameters;
    const std::vector<Eigen::VectorXd>& latents;
};

/// Slopes of -ln p (constraints included) along some directions at theta, shape (directions): w^T A d summed over all
/// blocks. Their rows are made from values with derivatives and divided by the errors one after the other, and not
/// kept. The parameters' prior is left out.
[[nodiscard]] Eigen::VectorXd slopes_along(const BlockSet& set, const std::vector<BlockValue>& values,
                                           const std::vector<Coordinate>& coordinates, const Eigen::VectorXd& theta,
                                           const std::vector<NoiseModel>& laws, const ErrorWeights& errors,
                                           const std::vector<Direction>& directions);

/// Whether the rows of all blocks are the same with Curvature::step (or guarded) and expected.
[[nodiscard]] bool has_one_curvature(const BlockSet& set, const std::vector<NoiseModel>& laws);

/// All blocks divided by the errors and factorised; constraints enter as rows divided by `matching`.
struct WhitenedArrow {
    BlockArrow arrow;
    /// Per block, kept on request; empty where the block-arrow matrix has them unchanged, see own_rows(). No blocks at
    /// all where that is so for every one.
    std::vector<WhitenedRows> rows;
    std::vector<Eigen::Index> linked_records;  ///< whitened rows of linked records per block
    double value = 0.0;                        ///< sum of the blocks' values

    /// A block's rows, shape (rows, latents + parameters + 1). Only if rows were kept.
    [[nodiscard]] Eigen::Ref<const Eigen::MatrixXd> own_rows(std::size_t b) const {
        return !rows.empty() && rows[b].rows.size() > 0 ? rows[b].rows : arrow.blocks[b].triangle;
    }
    /// Those of its linked records, shape (rows, latents + latents of next + parameters + 1).
    [[nodiscard]] Eigen::Ref<const Eigen::MatrixXd> linked_rows(std::size_t b) const {
        return arrow.blocks[b].link.bottomRows(linked_records[b]);
    }
};
/// @param factorised  false: the rows of the blocks alone, enough for model_change().
[[nodiscard]] WhitenedArrow standard_arrow(const std::vector<BlockRows>& rows, const std::vector<NoiseModel>& laws,
                                           const Eigen::VectorXd& psi, double matching, Curvature curvature,
                                           bool keep_rows = false, bool factorised = true, const Spread& spread = {});
/// The same, factorised, of a set that may be spread over ranks.
[[nodiscard]] inline WhitenedArrow standard_arrow(const BlockSet& set, const std::vector<BlockRows>& rows,
                                                  const std::vector<NoiseModel>& laws, const Eigen::VectorXd& psi,
                                                  double matching, Curvature curvature, bool keep_rows = false) {
    return standard_arrow(rows, laws, psi, matching, curvature, keep_rows, true, set.spread);
}

}  // namespace orbid::estimator
