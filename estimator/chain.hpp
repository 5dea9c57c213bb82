#pragma once

#include <cstddef>
#include <vector>

#include <Eigen/Core>

namespace orbid::estimator {

/// One node of a chain: rows on its own latent states, and rows that link it to the next node of the chain. All rows
/// are weighted; `next` is the following node of the same chain (the first one again in a cyclic chain).
struct ChainNode {
    std::size_t block = 0;     ///< which block of the stacked problem this is
    Eigen::Index latents = 0;  ///< l
    Eigen::MatrixXd own;       ///< [A_z | A | w], shape (rows, l + q + 1)
    Eigen::MatrixXd link;      ///< [C_z | C_next | C_theta | c], shape (rows, l + l_next + q + 1); no rows at the end
    Eigen::VectorXd limit;     ///< a column with less than this left is decided by nothing, shape (l)
};

/// Elimination of one node between its neighbours of that moment, or of the last one or two nodes of a chain together:
///
///     R_pivot (z_node, z_partner) + R_left z_left + R_right z_right + R_theta d + r = 0
struct Elimination {
    std::ptrdiff_t node = -1;     ///< position in the chain
    std::ptrdiff_t partner = -1;  ///< the other node of the last two, else -1
    std::ptrdiff_t left = -1;     ///< neighbours, -1 at the last elimination
    std::ptrdiff_t right = -1;
    Eigen::Index pivots = 0;          ///< latent states eliminated, l
    std::vector<Eigen::Index> order;  ///< k-th pivot = order[k]-th latent state; from `rank` on: decided by nothing
    Eigen::Index rank = 0;
    /// [R_pivot | R_left | R_right | R_theta | r], shape (rank, l + l_left + l_right + q + 1), columns of R_pivot in
    /// pivot order and cut to rank: upper triangle, shape (rank, rank).
    Eigen::MatrixXd rows;
};

/// Orthogonal factorisation of a chain or cyclic chain of latent states.
struct ChainFactor {
    bool cyclic = false;
    std::vector<std::size_t> block;     ///< of each node
    std::vector<Eigen::Index> latents;  ///< of each node
    /// Nodes eliminated level by level: within a level no two are neighbours.
    std::vector<std::vector<Elimination>> levels;
    Eigen::MatrixXd rest;  ///< triangle of what is left for [d | w], shape (q + 1, q + 1)
};

/// Eliminates every second node, then every second one of those left, ... ; both ends of an open chain stay to the last
/// and are eliminated together. Every node is thus eliminated between its two neighbours, expressed by the earlier one
/// in contracting and by the later one in expanding directions, so growth over the chain never multiplies up: what
/// elimination from both ends promises, and the nodes of a level are independent of each other. Cost linear in nodes.
/// Source: odd-even (cyclic) reduction with orthogonal transformations, S. J. Wright, "Stable parallel algorithms for
/// two-point boundary value problems", SIAM J. Sci. Stat. Comput. 13 (1992) 742; pivoting in eliminate().
/// @param parameters  q.
[[nodiscard]] ChainFactor factorise_chain(const std::vector<ChainNode>& nodes, bool cyclic, Eigen::Index parameters);

/// Best latent states for the parameters d, written to z[block]; states that nothing decides are zero.
void solve_chain(const ChainFactor& chain, const Eigen::VectorXd& d, std::vector<Eigen::VectorXd>& z);

/// Covariance of neighbours: of (z_b, y) for every node into node[block], of (z_b, z_next, y) for every link into
/// link[block of the node the link starts from], y = the parameters with the covariance given (0, 0: not varied, left
/// out). States that nothing decides have zeros. Every term is a sum of positive semidefinite ones. Linear cost.
void chain_covariance(const ChainFactor& chain, const Eigen::MatrixXd& parameter_covariance,
                      std::vector<Eigen::MatrixXd>& node, std::vector<Eigen::MatrixXd>& link);

}  // namespace orbid::estimator
