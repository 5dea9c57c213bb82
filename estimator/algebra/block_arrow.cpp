#include "estimator/algebra/block_arrow.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>
#include <utility>

#include "estimator/algebra/block_arrow_parts.hpp"

namespace orbid::estimator {

namespace {

/// A latent column whose part independent of the columns before it is below this fraction of it is rounding only.
constexpr double dead_share = 1e-13;

/// The same for a column of link rows: some tens of roundings, for the light rows count whatever the links weigh.
constexpr double dead_share_of_links = 64.0 * 2.220446049250313e-16;

/// The R factor without the dead columns; a unit row in their place keeps it regular and their step zero.
Eigen::MatrixXd without(const std::vector<bool>& dead, const Eigen::MatrixXd& triangle) {
    const Eigen::Index rows = triangle.rows();
    Eigen::MatrixXd extended = Eigen::MatrixXd::Zero(rows + std::count(dead.begin(), dead.end(), true), rows);
    extended.topRows(rows) = triangle;
    Eigen::Index extra = rows;
    for (std::size_t j = 0; j < dead.size(); ++j) {
        if (!dead[j]) continue;
        extended.col(static_cast<Eigen::Index>(j)).setZero();
        extended(extra++, static_cast<Eigen::Index>(j)) = 1.0;
    }
    return upper_triangle(extended);
}

void refuse(std::size_t block, const std::string& what) {
    throw std::invalid_argument("block " + std::to_string(block) + ": " + what);
}

bool has_next(const BlockTriangle& block) {
    return block.link.rows() > 0 && block.next >= 0;
}

/// Finds the chains, each from its first block (cyclic: from the block of least index).
void find_chains(BlockArrow& arrow, std::vector<bool>& cyclic) {
    const std::size_t count = arrow.blocks.size();
    std::vector<std::ptrdiff_t> before(count, -1);
    arrow.linked.assign(count, false);
    for (std::size_t b = 0; b < count; ++b) {
        const BlockTriangle& block = arrow.blocks[b];
        if (block.link.rows() == 0) continue;
        arrow.linked[b] = true;
        Eigen::Index columns = block.latents + arrow.parameters + 1;
        if (block.next >= 0) {
            const auto next = static_cast<std::size_t>(block.next);
            if (next >= count) refuse(b, "links to block " + std::to_string(next) + " of " + std::to_string(count));
            if (before[next] >= 0)
                refuse(b, "links to block " + std::to_string(next) + ", as does block " + std::to_string(before[next]));
            before[next] = static_cast<std::ptrdiff_t>(b);
            arrow.linked[next] = true;
            columns += arrow.blocks[next].latents;
        }
        if (block.link.cols() != columns)
            refuse(b,
                   "link rows have " + std::to_string(block.link.cols()) + " columns, not " + std::to_string(columns));
    }
    std::vector<bool> taken(count, false);
    for (const bool closed : {false, true}) {
        for (std::size_t b = 0; b < count; ++b) {
            if (!arrow.linked[b] || taken[b] || (!closed && before[b] >= 0)) continue;
            arrow.chains.emplace_back();
            cyclic.push_back(closed);
            for (std::size_t i = b; !taken[i]; i = static_cast<std::size_t>(arrow.blocks[i].next)) {
                taken[i] = true;
                arrow.chains.back().push_back(i);
                if (!has_next(arrow.blocks[i])) break;
            }
        }
    }
}

/// Norms of the columns of link rows that hit the states of each block of a chain, one block after the other.
Eigen::VectorXd link_norms(const BlockArrow& arrow, const std::vector<std::size_t>& chain) {
    Eigen::Index states = 0;
    for (const std::size_t b : chain)
        states += arrow.blocks[b].latents;
    Eigen::VectorXd square = Eigen::VectorXd::Zero(states);
    Eigen::Index at = 0;
    for (std::size_t i = 0; i < chain.size(); ++i) {
        const BlockTriangle& block = arrow.blocks[chain[i]];
        const Eigen::Index following = i + 1 < chain.size() ? at + block.latents : 0;
        const auto add = [&](Eigen::Index column, Eigen::Index to, Eigen::Index count) {
            for (Eigen::Index j = 0; j < count; ++j) {
                const double* values = block.link.data() + (column + j) * block.link.rows();
                for (Eigen::Index k = 0; k < block.link.rows(); ++k)
                    square[to + j] += values[k] * values[k];
            }
        };
        add(0, at, block.link.rows() > 0 ? block.latents : 0);
        if (has_next(block)) add(block.latents, following, arrow.blocks[static_cast<std::size_t>(block.next)].latents);
        at += block.latents;
    }
    return square.cwiseSqrt();
}

/// Squares of the norms of own and of link columns, over the states that have both.
struct NormSquares {
    double own = 0.0;
    double linked = 0.0;

    void add(const BlockTriangle& block, const Eigen::VectorXd& links, Eigen::Index at) {
        for (Eigen::Index j = 0; j < block.latents; ++j) {
            if (!(block.norm[j] > 0.0) || !(links[at + j] > 0.0)) continue;
            own += block.norm[j] * block.norm[j];
            linked += links[at + j] * links[at + j];
        }
    }
    [[nodiscard]] double ratio(double other) const { return linked > 0.0 ? std::sqrt(own / linked) : other; }
};

/// Norms of the own columns of a chain's blocks, and their squares.
NormSquares own_norms(BlockArrow& arrow, const std::vector<std::size_t>& chain, const Eigen::VectorXd& linked) {
    NormSquares squares;
    Eigen::Index at = 0;
    for (const std::size_t b : chain) {
        BlockTriangle& block = arrow.blocks[b];
        block.norm = block.triangle.leftCols(block.latents).colwise().norm().transpose();
        squares.add(block, linked, at);
        at += block.latents;
    }
    return squares;
}

/// Damping metric of a chain's blocks where they have no own rows, see BlockTriangle::norm.
void complete_norms(BlockArrow& arrow, const std::vector<std::size_t>& chain, const Eigen::VectorXd& linked,
                    double common) {
    Eigen::Index at = 0;
    for (const std::size_t b : chain) {
        BlockTriangle& block = arrow.blocks[b];
        NormSquares squares;
        squares.add(block, linked, at);
        const double ratio = squares.ratio(common);
        for (Eigen::Index j = 0; j < block.latents; ++j) {
            if (block.norm[j] > 0.0) continue;
            block.norm[j] = ratio * linked[at + j];
            if (!(block.norm[j] > 0.0)) block.norm[j] = 1.0;
        }
        at += block.latents;
    }
}

/// Damping metric of all chains. Those that are spread over ranks count as one.
void set_norms(BlockArrow& arrow) {
    std::vector<double> common(arrow.chains.size());
    NormSquares parts;
    for (std::size_t i = 0; i < arrow.chains.size(); ++i) {
        const NormSquares squares = own_norms(arrow, arrow.chains[i], arrow.link_norms[i]);
        common[i] = squares.ratio(1.0);
        if (std::find(arrow.parts.begin(), arrow.parts.end(), i) == arrow.parts.end()) continue;
        parts.own += squares.own;
        parts.linked += squares.linked;
    }
    parts = {arrow.spread.sum(parts.own), arrow.spread.sum(parts.linked)};
    for (const std::size_t i : arrow.parts)
        common[i] = parts.ratio(1.0);
    for (std::size_t i = 0; i < arrow.chains.size(); ++i)
        complete_norms(arrow, arrow.chains[i], arrow.link_norms[i], common[i]);
}

/// Marks the states that the factorisation found undecided.
void mark_dead(BlockArrow& arrow, const ChainFactor& factor) {
    for_undecided(factor, [&](std::size_t node, Eigen::Index state) {
        arrow.blocks[factor.block[node]].dead[static_cast<std::size_t>(state)] = true;
    });
}

}  // namespace

BlockTriangle block_triangle(const Eigen::Ref<const Eigen::MatrixXd>& rows, Eigen::Index latents) {
    BlockTriangle block;
    block.latents = latents;
    block.norm = rows.leftCols(latents).colwise().norm().transpose();
    block.dead.assign(static_cast<std::size_t>(latents), false);
    block.triangle = upper_triangle(rows);
    bool any_dead = false;
    for (Eigen::Index j = 0; j < latents; ++j) {
        if (std::abs(block.triangle(j, j)) > dead_share * block.norm[j]) continue;
        block.dead[static_cast<std::size_t>(j)] = true;
        block.norm[j] = 1.0;
        any_dead = true;
    }
    if (!any_dead) return block;
    Eigen::MatrixXd regular = without(block.dead, block.triangle);
    block.undecided = std::exchange(block.triangle, std::move(regular));
    return block;
}

BlockTriangle linked_block(Eigen::MatrixXd rows, Eigen::Index latents) {
    BlockTriangle block;
    block.latents = latents;
    block.dead.assign(static_cast<std::size_t>(latents), false);
    block.triangle = rows.rows() > rows.cols() ? upper_triangle(rows) : std::move(rows);
    return block;
}

Eigen::VectorXd column_limits(const BlockTriangle& block, const Eigen::Ref<const Eigen::VectorXd>& linked) {
    return (dead_share * block.triangle.leftCols(block.latents).colwise().norm().transpose())
        .cwiseMax(dead_share_of_links * linked);
}

ChainFactor factorise_chain(const BlockArrow& arrow, std::size_t index, bool cyclic, double mu) {
    const std::vector<std::size_t>& chain = arrow.chains[index];
    const Eigen::VectorXd& linked = arrow.link_norms[index];
    std::vector<ChainNode> nodes(chain.size());
    Eigen::VectorXd limit(linked.size());
    Eigen::Index at = 0;
    for (std::size_t i = 0; i < chain.size(); ++i) {
        const BlockTriangle& block = arrow.blocks[chain[i]];
        const Eigen::Index l = block.latents;
        ChainNode& node = nodes[i];
        node.block = chain[i];
        node.latents = l;
        node.own = &block.triangle;
        if (block.link.rows() > 0) (block.next < 0 ? node.alone : node.link) = &block.link;
        if (mu > 0.0 && arrow.spread.owns(chain[i])) {
            node.damping = std::sqrt(mu);
            node.norm = &block.norm;
        }
        limit.segment(at, l) = column_limits(block, linked.segment(at, l));
        node.limit = limit.data() + at;
        if (std::find(block.dead.begin(), block.dead.end(), true) != block.dead.end()) node.dead = &block.dead;
        at += l;
    }
    const bool part = std::find(arrow.parts.begin(), arrow.parts.end(), index) != arrow.parts.end();
    return factorise_chain(nodes, cyclic, arrow.parameters, part);
}

BlockArrow factorise(std::vector<BlockTriangle> blocks, Eigen::Index parameters, const Spread& spread) {
    BlockArrow arrow;
    arrow.spread = spread;
    arrow.parameters = parameters;
    arrow.blocks = std::move(blocks);
    std::vector<bool> cyclic;
    find_chains(arrow, cyclic);
    for (std::size_t b = 0; b < arrow.blocks.size(); ++b) {
        BlockTriangle& block = arrow.blocks[b];
        if (!arrow.linked[b] || block.undecided.size() == 0) continue;
        block.triangle = std::move(block.undecided);
        block.undecided.resize(0, 0);
        block.dead.assign(block.dead.size(), false);
    }
    const Eigen::Index width = parameters + 1;
    const Eigen::Index alone = std::count(arrow.linked.begin(), arrow.linked.end(), false);
    if (arrow.blocks.size() == 1 && alone == 1) {
        arrow.pool = arrow.blocks[0].triangle.bottomRightCorner(width, width);
    } else {
        Eigen::MatrixXd stacked(alone * width, width);
        Eigen::Index row = 0;
        for (std::size_t b = 0; b < arrow.blocks.size(); ++b) {
            if (arrow.linked[b]) continue;
            stacked.middleRows(row, width) = arrow.blocks[b].triangle.bottomRightCorner(width, width);
            row += width;
        }
        arrow.pool = upper_triangle(stacked);
    }
    for (const std::vector<std::size_t>& chain : arrow.chains)
        arrow.link_norms.push_back(link_norms(arrow, chain));
    if (!spread.alone()) find_parts(arrow);
    set_norms(arrow);
    for (std::size_t i = 0; i < arrow.chains.size(); ++i) {
        arrow.undamped.push_back(std::make_shared<const ChainFactor>(factorise_chain(arrow, i, cyclic[i], 0.0)));
        mark_dead(arrow, *arrow.undamped.back());
    }
    if (!spread.alone()) join_undamped(arrow);
    return arrow;
}

}  // namespace orbid::estimator
