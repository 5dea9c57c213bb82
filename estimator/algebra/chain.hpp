#pragma once

#include <array>
#include <cstddef>
#include <functional>
#include <vector>

#include <Eigen/Core>

namespace orbid::estimator {

/// One node of a chain: rows on its own latent states, and rows that link it to the next node of the chain. All rows
/// are weighted. `next` is the following node of the same chain (the first one again in a cyclic chain). Matrices and
/// vectors are those of the stacked problem and not copied.
struct ChainNode {
    std::size_t block = 0;                   ///< which block of the stacked problem this is
    Eigen::Index latents = 0;                ///< l
    const Eigen::MatrixXd* own = nullptr;    ///< [A_z | A | w], shape (rows, l + q + 1)
    const Eigen::MatrixXd* alone = nullptr;  ///< further rows of that shape; null: none
    /// [C_z | C_next | C_theta | c], shape (rows, l + l_next + q + 1); null at the end of an open chain
    const Eigen::MatrixXd* link = nullptr;
    double damping = 0.0;
    const Eigen::VectorXd* norm = nullptr;    ///< further rows: damping norm[k] z_k, shape (l); null: none
    const double* limit = nullptr;            ///< a column with less than this left is undetermined, shape (l)
    const std::vector<bool>* dead = nullptr;  ///< states that leave the problem; null: none
};

/// Elimination of one node between its neighbours at that stage, or of the last one or two nodes of a chain together:
///
///     R_pivot (z_node, z_partner) + R_left z_left + R_right z_right + R_theta d + r = 0
struct Elimination {
    std::ptrdiff_t node = -1;     ///< position in the chain
    std::ptrdiff_t partner = -1;  ///< the other node of the last two, else -1
    std::ptrdiff_t left = -1;     ///< neighbours, -1 at the last elimination
    std::ptrdiff_t right = -1;
    Eigen::Index pivots = 0;   ///< latent states eliminated, l
    Eigen::Index rank = 0;     ///< of them, decided by something
    Eigen::Index columns = 0;  ///< rank + l_left + l_right + q + 1
    std::size_t place = 0;     ///< in ChainLevel::values
    std::size_t first = 0;     ///< in ChainLevel::order
};

/// Nodes eliminated at the same time: no two are neighbours.
struct ChainLevel {
    std::vector<Elimination> steps;
    std::vector<double> values;       ///< of all rows, one elimination after the other
    std::vector<Eigen::Index> order;  ///< k-th pivot = order[first + k]-th latent state; from `rank` on: undetermined

    /// [R_pivot | R_left | R_right | R_theta | r], shape (rank, columns). R_pivot has its columns in pivot order and is
    /// cut to rank: upper triangle, shape (rank, rank).
    [[nodiscard]] Eigen::Map<const Eigen::MatrixXd> rows(const Elimination& step) const {
        return {values.data() + step.place, step.rank, step.columns};
    }
};

/// Orthogonal factorisation of a chain or cyclic chain of latent states.
struct ChainFactor {
    bool cyclic = false;
    std::vector<std::size_t> block;     ///< of each node
    std::vector<Eigen::Index> latents;  ///< of each node
    std::vector<ChainLevel> levels;
    Eigen::MatrixXd rest;  ///< R factor of what is left for [d | w], shape (q + 1, q + 1)
    /// Of a part of a chain: rows that are left between its ends, [z_first | z_last | d | w], and the own rows of both,
    /// [z | d | w]. Own rows are the lightest: they stay as they are until their node is eliminated, as in a chain.
    Eigen::MatrixXd ends;
    std::array<Eigen::MatrixXd, 2> own_of_ends;
};

/// Eliminates every second node, then every second remaining one, ... ; both ends of an open chain stay to the last and
/// are eliminated together. Every node is thus eliminated between its two neighbours. The earlier one expresses it in
/// contracting directions and the later one in expanding directions, so growth over the chain never multiplies up.
/// Elimination from both ends has the same property, but here the nodes of a level are independent of each other. Cost
/// linear in nodes. Source: odd-even (cyclic) reduction with orthogonal transformations, S. J. Wright, "Stable parallel
/// algorithms for two-point boundary value problems", SIAM J. Sci. Stat. Comput. 13 (1992) 742; pivoting in
/// eliminate().
/// @param parameters  q.
/// @param part        the ends of an open chain of two nodes or more stay, see ChainFactor::ends.
[[nodiscard]] ChainFactor factorise_chain(const std::vector<ChainNode>& nodes, bool cyclic, Eigen::Index parameters,
                                          bool part = false);

/// Best latent states for the parameters d, written to z[block]; undetermined states are zero. Those of the ends of a
/// part must be there.
void solve_chain(const ChainFactor& chain, const Eigen::VectorXd& d, std::vector<Eigen::VectorXd>& z);

/// Sum of ln|R_jj| over all latent states of the chain.
[[nodiscard]] double log_abs_determinant(const ChainFactor& chain);

/// Calls use(position in the chain, state) for every state that nothing decides; the ends of a part are left out.
template <class Use>
void for_undecided(const ChainFactor& chain, const Use& use) {
    for (const ChainLevel& level : chain.levels)
        for (const Elimination& step : level.steps)
            for (Eigen::Index k = step.rank; k < step.pivots; ++k) {
                const Eigen::Index j = level.order[step.first + static_cast<std::size_t>(k)];
                const auto node = static_cast<std::size_t>(step.node);
                const Eigen::Index own = chain.latents[node];
                if (j < own)
                    use(node, j);
                else
                    use(static_cast<std::size_t>(step.partner), j - own);
            }
}

/// Receives a covariance matrix and the block it belongs to; called from several threads, once for each block.
using CovarianceUse = std::function<void(std::size_t block, const Eigen::Ref<const Eigen::MatrixXd>& covariance)>;

/// Covariance of neighbours: of (z_b, y) for every node to `node`, of (z_b, z_next, y) for every link to `link` (block:
/// of the node the link starts from; an empty function: not wanted). y = the parameters with the covariance given (0,
/// 0: not varied, left out). Undetermined states have zeros. Every term is a sum of positive semidefinite ones. Linear
/// cost; memory for the links of half the nodes.
void chain_covariance(const ChainFactor& chain, const Eigen::MatrixXd& parameter_covariance, const CovarianceUse& node,
                      const CovarianceUse& link);

/// The same for a part of a chain. @param ends  covariance of (z_first, z_last, y).
void part_covariance(const ChainFactor& part, const Eigen::MatrixXd& ends, const Eigen::MatrixXd& parameter_covariance,
                     const CovarianceUse& node, const CovarianceUse& link);

}  // namespace orbid::estimator
