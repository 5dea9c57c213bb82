#include "estimator/algebra/block_arrow_parts.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

namespace orbid::estimator {

namespace {

[[noreturn]] void refuse_end(std::ptrdiff_t block, const std::string& what) {
    throw std::invalid_argument("block " + std::to_string(block) + ", which two ranks have, " + what);
}

/// The chain that begins, or ends, with a block.
std::size_t chain_with_end(const BlockArrow& arrow, std::ptrdiff_t block, bool begins) {
    for (std::size_t i = 0; i < arrow.chains.size(); ++i) {
        const std::vector<std::size_t>& chain = arrow.chains[i];
        const auto end = static_cast<std::ptrdiff_t>(begins ? chain.front() : chain.back());
        if (end == block && chain.size() > 1) return i;
    }
    refuse_end(block, begins ? "must begin a chain of two blocks or more" : "must end a chain of two blocks or more");
}

/// Norms of the link columns of a block that two ranks have, from the links of both. Every rank has a message of its
/// neighbours, whether they share a block or not.
void share_link_norms(BlockArrow& arrow) {
    Collective& ranks = *arrow.spread.ranks;
    ranks.begin(Collective::Operation::neighbours);
    const auto latents = [&arrow](std::ptrdiff_t block) {
        return block >= 0 ? arrow.blocks[static_cast<std::size_t>(block)].latents : 0;
    };
    const auto send = [&ranks](int to, const Eigen::VectorXd& norms) {
        RankNumbers numbers;
        numbers.put(Eigen::MatrixXd(norms));
        ranks.send(to, numbers);
    };
    const Eigen::Index l_first = latents(arrow.spread.before);
    const Eigen::Index l_last = latents(arrow.spread.after);
    const bool has_next = ranks.rank() + 1 < ranks.count();
    Eigen::VectorXd none;
    Eigen::VectorXd& first = arrow.parts.empty() ? none : arrow.link_norms[arrow.parts.front()];
    Eigen::VectorXd& last = arrow.parts.empty() ? none : arrow.link_norms[arrow.parts.back()];
    if (has_next) send(ranks.rank() + 1, last.tail(l_last));
    if (ranks.rank() > 0) {
        const Eigen::VectorXd other = ranks.receive(ranks.rank() - 1).take_matrix();
        if (other.size() != l_first)
            throw std::invalid_argument("ranks " + std::to_string(ranks.rank() - 1) + " and " +
                                        std::to_string(ranks.rank()) +
                                        ": the ends of their parts of a chain do not fit together");
        for (Eigen::Index j = 0; j < l_first; ++j)
            first[j] = std::hypot(first[j], other[j]);
        send(ranks.rank() - 1, first.head(l_first));
    }
    if (has_next) last.tail(l_last) = ranks.receive(ranks.rank() + 1).take_matrix();
    ranks.end_with_neighbours(2);
    if (!has_next && l_last > 0) refuse_end(arrow.spread.after, "is on the last rank");
    if (ranks.rank() == 0 && l_first > 0) refuse_end(arrow.spread.before, "is on the first rank");
}

/// R factor of the rows that this rank has left for [d | w] without damping.
Eigen::MatrixXd own_rest(const BlockArrow& arrow) {
    const Eigen::Index width = arrow.parameters + 1;
    Eigen::MatrixXd stacked(width * static_cast<Eigen::Index>(arrow.chains.size() + 1), width);
    stacked.topRows(width) = arrow.pool;
    Eigen::Index row = width;
    for (const auto& chain : arrow.undamped) {
        stacked.middleRows(row, width) = chain->rest;
        row += width;
    }
    return upper_triangle(stacked);
}

}  // namespace

void find_parts(BlockArrow& arrow) {
    const Spread& spread = arrow.spread;
    if (spread.before >= 0) arrow.parts.push_back(chain_with_end(arrow, spread.before, true));
    if (spread.after >= 0) {
        const std::size_t last = chain_with_end(arrow, spread.after, false);
        if (arrow.parts.empty() || arrow.parts.front() != last) arrow.parts.push_back(last);
        if (arrow.blocks[static_cast<std::size_t>(spread.after)].triangle.rows() > 0)
            refuse_end(spread.after, "has rows of its own on the first of them: they belong to the second");
    }
    share_link_norms(arrow);
}

std::shared_ptr<const PartJoins> join_chains(const BlockArrow& arrow,
                                             const std::vector<std::shared_ptr<const ChainFactor>>& chains,
                                             Eigen::MatrixXd& rest) {
    std::vector<ChainPart> parts;
    for (const std::size_t i : arrow.parts) {
        const std::vector<std::size_t>& chain = arrow.chains[i];
        const BlockTriangle& first = arrow.blocks[chain.front()];
        const BlockTriangle& last = arrow.blocks[chain.back()];
        ChainPart part;
        part.first = first.latents;
        part.last = last.latents;
        part.earlier = static_cast<std::ptrdiff_t>(chain.front()) == arrow.spread.before;
        part.later = static_cast<std::ptrdiff_t>(chain.back()) == arrow.spread.after;
        part.rows = chains[i]->ends;
        part.own = chains[i]->own_of_ends;
        part.limit.resize(part.first + part.last);
        part.limit << column_limits(first, arrow.link_norms[i].head(part.first)),
            column_limits(last, arrow.link_norms[i].tail(part.last));
        parts.push_back(std::move(part));
    }
    return std::make_shared<const PartJoins>(*arrow.spread.ranks, std::move(parts), rest);
}

void join_undamped(BlockArrow& arrow) {
    arrow.undamped_rest = own_rest(arrow);
    arrow.undamped_joins = join_chains(arrow, arrow.undamped, arrow.undamped_rest);
    const std::vector<Eigen::MatrixXd> undecided = arrow.undamped_joins->undecided();
    for (std::size_t k = 0; k < arrow.parts.size(); ++k) {
        const std::vector<std::size_t>& chain = arrow.chains[arrow.parts[k]];
        Eigen::Index at = 0;
        for (const std::size_t b : {chain.front(), chain.back()})
            for (Eigen::Index j = 0; j < arrow.blocks[b].latents; ++j, ++at)
                if (undecided[k](at, 0) > 0.0) arrow.blocks[b].dead[static_cast<std::size_t>(j)] = true;
    }
}

}  // namespace orbid::estimator
