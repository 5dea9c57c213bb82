#pragma once

#include <cstddef>
#include <memory>
#include <vector>

#include <Eigen/Core>

#include "estimator/algebra/chain.hpp"
#include "estimator/algebra/part_joins.hpp"
#include "estimator/algebra/r_factor.hpp"
#include "estimator/algebra/spread.hpp"

namespace orbid::estimator {

/// Rows of one block of a stacked least-squares problem: [A_z | A | w]. The columns of its own latent states come
/// first, then the common parameters, then the right-hand side. In a chain, also the rows that link it to another
/// block.
struct BlockTriangle {
    Eigen::Index latents = 0;
    /// Upper trapezoid of the orthogonal factorisation, shape (latents + q + 1, latents + q + 1). For a linked block
    /// the rows themselves if they are no more than that.
    Eigen::MatrixXd triangle;
    /// Lengths of the latent columns, > 0, shape (latents): the damping metric D_z. Without links the norms of the
    /// block's own columns (1 where dead). factorise() sets it for linked blocks, again from own columns, so that the
    /// weight of the links does not enter. A column that is zero in the block's own rows gets its norm in the link rows
    /// times a ratio of own to link norms. The ratio is taken over the columns that have both (of this block, else of
    /// the chain, else 1).
    Eigen::VectorXd norm;
    std::vector<bool> dead;  ///< latent states that are undetermined (given the earlier ones): they are held
    /// Rows [C_z | C_next | C_theta | c], already weighted, shape (rows, latents + latents of `next` + q + 1). With
    /// next = -1 C_next has no columns; with next = the block itself both parts act on its own states. Empty = none.
    Eigen::MatrixXd link;
    std::ptrdiff_t next = -1;  ///< index into BlockArrow::blocks of the block whose states C_next multiplies
    /// Only where a latent state is dead by the block's own rows: the R factor with it. A link may still determine it.
    Eigen::MatrixXd undecided;
};

/// The stacked problem
///
///     min_{d, d_z} sum_b ||A_z,b d_z,b + A_b d + w_b||^2 + ||C_z,b d_z,b + C_next,b d_z,next + C_theta,b d + c_b||^2
///
/// by orthogonal factorisation: blocks without links one by one (block-arrow matrix), chains and cyclic chains by
/// odd-even elimination. No normal equations, no matrix of the whole size, cost linear in the blocks. Link rows may
/// weigh 1e10 times the others.
///
/// Spread over ranks, each has its blocks, and the rows that belong to them. factorise(), condense() with damping,
/// latent_steps(), model_change(), log_abs_determinant() and other sums, and visit_covariance() are then operations of
/// all ranks together; parameters and sums are the same on each.
struct BlockArrow {
    Eigen::Index parameters = 0;
    std::vector<BlockTriangle> blocks;
    Eigen::MatrixXd pool;      ///< R factor of the rows below the latent ones without links, shape (q + 1, q + 1)
    std::vector<bool> linked;  ///< blocks that belong to a chain (a block with link rows is one of its own)
    std::vector<std::vector<std::size_t>> chains;  ///< blocks of each chain in order
    /// Norm of each latent state's column in the link rows of each chain, one block after the other.
    std::vector<Eigen::VectorXd> link_norms;
    std::vector<std::shared_ptr<const ChainFactor>> undamped;  ///< of each chain
    Spread spread;
    std::vector<std::size_t> parts;  ///< chains that other ranks have parts of, in order
    std::shared_ptr<const PartJoins> undamped_joins;
    Eigen::MatrixXd undamped_rest;  ///< R factor of [d | w] of all ranks; these two only if spread
};

/// The problem for the parameters after the latent states took their best values (Schur complement). The latent steps
/// are damped by mu ||D_z d_z||^2, D_z = BlockTriangle::norm.
struct ReducedProblem {
    /// Per block [R_zz | R_z | r_z], shape (latents, latents + q + 1); no rows for linked blocks, see `chains`.
    /// Empty where all blocks are linked.
    std::vector<Eigen::MatrixXd> top;
    std::vector<std::shared_ptr<const ChainFactor>> chains;
    Eigen::MatrixXd r;    ///< upper triangle, shape (q, q)
    Eigen::VectorXd rhs;  ///< shape (q): minimise ||r d + rhs||^2
    double rest = 0.0;    ///< ||.|| that no step can remove
    Spread spread;
    std::shared_ptr<const PartJoins> joins;  ///< of the chains that are spread over ranks

    /// Frees all that has a part for every block; what the parameters need stays.
    void drop_blocks() {
        top = {};
        chains.clear();
        joins.reset();
    }
};

/// Factorises one block's rows [A_z | A | w] (any number of rows). `link` and `next` are set by the caller afterwards.
[[nodiscard]] BlockTriangle block_triangle(const Eigen::Ref<const Eigen::MatrixXd>& rows, Eigen::Index latents);

/// The same for a block that has link rows, or that one links to: its rows are kept unchanged if they are few.
[[nodiscard]] BlockTriangle linked_block(Eigen::MatrixXd rows, Eigen::Index latents);

/// Puts the blocks together and factorises the chains. In chains a latent state is dead if almost nothing is left of
/// its column when it is eliminated. The limits are 1e-13 of its own rows' norm, or 1e-14 of its norm with the links.
/// If several are undetermined only together, the one with the least left is held.
/// @throws std::invalid_argument if link rows have the wrong number of columns, `next` is not a block, or two blocks
///         link to the same one; if a block that two ranks have is not an end of a chain, or the first of the two has
///         rows for it.
[[nodiscard]] BlockArrow factorise(std::vector<BlockTriangle> blocks, Eigen::Index parameters,
                                   const Spread& spread = {});

/// What must be left of a linked block's columns, see factorise(). @param linked  norms of its link columns.
[[nodiscard]] Eigen::VectorXd column_limits(const BlockTriangle& block,
                                            const Eigen::Ref<const Eigen::VectorXd>& linked);

/// Factorises one of its chains, damped by mu; dead states leave the problem.
[[nodiscard]] ChainFactor factorise_chain(const BlockArrow& arrow, std::size_t index, bool cyclic, double mu);

/// Eliminates the latent states. @param mu  damping, >= 0.
[[nodiscard]] ReducedProblem condense(const BlockArrow& arrow, double mu);

/// The latent steps that belong to the parameter step d: R_zz d_z = -(r_z + R_z d). One vector per block.
[[nodiscard]] std::vector<Eigen::VectorXd> latent_steps(const BlockArrow& arrow, const ReducedProblem& reduced_problem,
                                                        const Eigen::VectorXd& d);

/// Change of 1/2 ||A d + w||^2 by a step, link rows included, and ||A d||^2, without cancellation.
struct ModelChange {
    double linear = 0.0;     ///< w^T A d
    double quadratic = 0.0;  ///< ||A d||^2
};
[[nodiscard]] ModelChange model_change(const BlockArrow& arrow, const Eigen::VectorXd& d,
                                       const std::vector<Eigen::VectorXd>& d_z);

/// Change of 1/2 ||A d + w||^2 of each block with its links.
[[nodiscard]] std::vector<double> model_changes(const BlockArrow& arrow, const Eigen::VectorXd& d,
                                                const std::vector<Eigen::VectorXd>& d_z);

/// Sum of ln|R_jj| over all latent states, links included: ln|H_zz| is twice that. Dead states contribute nothing.
[[nodiscard]] double log_abs_determinant(const ReducedProblem& reduced_problem);

/// Number of latent states that nothing determines.
[[nodiscard]] Eigen::Index undetermined_states(const BlockArrow& arrow);

/// Passes every block's covariance of (z_b, y) to `node`, and that of (z_b, z_next, y) of blocks with next >= 0 and
/// link rows to `link` (empty: not wanted); see chain_covariance(). Links of moderate weight only: at tight ones
/// C P C^T is a difference of nearly equal numbers.
///
/// Latent states vary around the parameters (any covariance of them, for instance a sandwich; (0, 0): held): z = G y +
/// noise with covariance (R_zz^T R_zz)^-1. Rows and columns of dead states are zero. Linear cost; nothing is kept.
void visit_covariance(const BlockArrow& arrow, const ReducedProblem& reduced_problem,
                      const Eigen::MatrixXd& parameter_covariance, const CovarianceUse& node,
                      const CovarianceUse& link);

/// Covariance R^-1 R^-T of the parameters from the R factor of the reduced problem with prior rows; (0, 0) of (0, 0).
[[nodiscard]] Eigen::MatrixXd inverse_square(const Eigen::MatrixXd& triangle);

}  // namespace orbid::estimator
