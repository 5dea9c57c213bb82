#include "estimator/algebra/block_arrow.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>
#include <utility>

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

/// Damping metric of a chain's blocks, see BlockTriangle::norm.
void set_norms(BlockArrow& arrow, const std::vector<std::size_t>& chain, const Eigen::VectorXd& linked) {
    double own_square = 0.0;
    double link_square = 0.0;
    const auto add = [&linked](const BlockTriangle& block, Eigen::Index at, double& own, double& other) {
        for (Eigen::Index j = 0; j < block.latents; ++j) {
            if (!(block.norm[j] > 0.0) || !(linked[at + j] > 0.0)) continue;
            own += block.norm[j] * block.norm[j];
            other += linked[at + j] * linked[at + j];
        }
    };
    Eigen::Index at = 0;
    for (const std::size_t b : chain) {
        BlockTriangle& block = arrow.blocks[b];
        block.norm = block.triangle.leftCols(block.latents).colwise().norm().transpose();
        add(block, at, own_square, link_square);
        at += block.latents;
    }
    const double common = link_square > 0.0 ? std::sqrt(own_square / link_square) : 1.0;
    at = 0;
    for (const std::size_t b : chain) {
        BlockTriangle& block = arrow.blocks[b];
        double own = 0.0;
        double other = 0.0;
        add(block, at, own, other);
        const double ratio = other > 0.0 ? std::sqrt(own / other) : common;
        for (Eigen::Index j = 0; j < block.latents; ++j) {
            if (block.norm[j] > 0.0) continue;
            block.norm[j] = ratio * linked[at + j];
            if (!(block.norm[j] > 0.0)) block.norm[j] = 1.0;
        }
        at += block.latents;
    }
}

/// Marks the states that the factorisation found undecided.
void mark_dead(BlockArrow& arrow, const ChainFactor& factor) {
    for (const ChainLevel& level : factor.levels) {
        for (const Elimination& step : level.steps) {
            for (Eigen::Index k = step.rank; k < step.pivots; ++k) {
                auto j = static_cast<std::size_t>(level.order[step.first + static_cast<std::size_t>(k)]);
                auto node = static_cast<std::size_t>(step.node);
                const auto own = static_cast<std::size_t>(factor.latents[node]);
                if (j >= own) {
                    j -= own;
                    node = static_cast<std::size_t>(step.partner);
                }
                arrow.blocks[factor.block[node]].dead[j] = true;
            }
        }
    }
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

ChainFactor factorise_chain(const BlockArrow& arrow, std::size_t index, bool cyclic, double mu) {
    const std::vector<std::size_t>& chain = arrow.chains[index];
    const Eigen::VectorXd& linked = arrow.link_norms[index];
    std::vector<ChainNode> nodes(chain.size());
    Eigen::Index at = 0;
    for (std::size_t i = 0; i < chain.size(); ++i) {
        const BlockTriangle& block = arrow.blocks[chain[i]];
        const Eigen::Index l = block.latents;
        ChainNode& node = nodes[i];
        node.block = chain[i];
        node.latents = l;
        node.own = &block.triangle;
        if (block.link.rows() > 0) (block.next < 0 ? node.alone : node.link) = &block.link;
        if (mu > 0.0) node.damping = std::sqrt(mu) * block.norm;
        node.limit = (dead_share * block.triangle.leftCols(l).colwise().norm().transpose())
                         .cwiseMax(dead_share_of_links * linked.segment(at, l));
        if (std::find(block.dead.begin(), block.dead.end(), true) != block.dead.end()) node.dead = &block.dead;
        at += l;
    }
    return factorise_chain(nodes, cyclic, arrow.parameters);
}

BlockArrow factorise(std::vector<BlockTriangle> blocks, Eigen::Index parameters) {
    BlockArrow arrow;
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
    for (std::size_t i = 0; i < arrow.chains.size(); ++i) {
        arrow.link_norms.push_back(link_norms(arrow, arrow.chains[i]));
        set_norms(arrow, arrow.chains[i], arrow.link_norms[i]);
        arrow.undamped.push_back(std::make_shared<const ChainFactor>(factorise_chain(arrow, i, cyclic[i], 0.0)));
        mark_dead(arrow, *arrow.undamped.back());
    }
    return arrow;
}

}  // namespace orbid::estimator
