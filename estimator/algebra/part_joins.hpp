#pragma once

#include <array>
#include <memory>
#include <vector>

#include <Eigen/Core>

#include "estimator/algebra/chain.hpp"
#include "estimator/ranks/collective.hpp"

namespace orbid::estimator {

/// What the elimination of the inner nodes of a part of a chain leaves.
struct ChainPart {
    Eigen::Index first = 0;              ///< latent states of its first node
    Eigen::Index last = 0;               ///< of its last node
    bool earlier = false;                ///< the first node is the last one of a part of the previous rank
    bool later = false;                  ///< the last node is the first one of a part of the next rank
    Eigen::MatrixXd rows;                ///< between both, see ChainFactor::ends
    std::array<Eigen::MatrixXd, 2> own;  ///< of each, see ChainFactor::own_of_ends
    Eigen::VectorXd limit;               ///< of the columns of both nodes, see ChainNode::limit
};

/// The chains that are spread over ranks, from the parts that the ranks have: parts of successive ranks are joined
/// pairwise along the tree of Collective, by eliminating the node between them. The ends of a chain are eliminated
/// together when both have met, as in factorise_chain().
///
/// All functions but log_abs_determinant() are operations of all ranks together. Every rank has one message of each
/// partner in each of them. Results depend on the number of ranks by rounding only.
class PartJoins {
public:
    /// @param own   parts of this rank in the order of the chains: at most the one that began earlier and the one that
    ///              goes on, which may be the same.
    /// @param rest  R factor of what this rank has left for [d | w], shape (q + 1, q + 1); on return that of all ranks.
    /// @throws std::invalid_argument when parts of neighbours do not belong together.
    PartJoins(Collective& ranks, std::vector<ChainPart> own, Eigen::MatrixXd& rest);

    /// Best states (z_first, z_last) of each own part for the parameters d, shape (first + last, 1).
    [[nodiscard]] std::vector<Eigen::MatrixXd> solve(const Eigen::VectorXd& d) const;
    /// Covariance of (z_first, z_last, y) of each own part, see chain_covariance().
    [[nodiscard]] std::vector<Eigen::MatrixXd> covariance(const Eigen::MatrixXd& parameter_covariance) const;
    /// Which states (z_first, z_last) of each own part nothing decides: 1, else 0. Shape (first + last, 1).
    [[nodiscard]] std::vector<Eigen::MatrixXd> undecided() const;
    /// Sum of ln|R_jj| over the states eliminated on this rank.
    [[nodiscard]] double log_abs_determinant() const;

private:
    /// Parts of this rank's range and of the following one, whose leader is `other`.
    struct Join {
        int other = 0;
        std::size_t parts = 0;  ///< of this range, before the join
        bool meets = false;     ///< the last part of this one goes on in the first of the other: `factor`
        bool complete = false;  ///< that is a whole chain: no end is left
        ChainFactor factor;     ///< of its nodes (first, between, last)
    };

    template <class Whole, class Within>
    std::vector<Eigen::MatrixXd> descend(const Whole& whole, const Within& within) const;

    Collective& ranks_;
    std::size_t own_ = 0;      ///< number of own parts
    std::vector<Join> joins_;  ///< of this rank, in the order they were made
};

}  // namespace orbid::estimator
