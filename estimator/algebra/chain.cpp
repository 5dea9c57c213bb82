#include "estimator/algebra/chain.hpp"

#include <algorithm>
#include <utility>

#include "estimator/algebra/block_loop.hpp"
#include "estimator/algebra/chain_rows.hpp"
#include "estimator/algebra/r_factor.hpp"

namespace orbid::estimator {

namespace {

using namespace detail;

/// What is in work: the nodes left, in order, and the rows between each and the following one.
struct Reduction {
    const std::vector<ChainNode>& nodes;
    Eigen::Index width;  ///< q + 1
    std::vector<std::size_t> left;
    std::vector<Edge> edge;         ///< edge[i] between left[i] and left[i + 1] (cyclic: the last and the first)
    std::vector<double> pool;       ///< of the edges that are no original links
    std::vector<double> next_pool;  ///< of those in the making
};

/// Keeps the rows of an elimination at its place, columns of the pivots in their order.
void keep(const Rows& a, const Eigen::Index* order, Elimination& step, ChainLevel& level) {
    const Eigen::Index others = a.cols() - step.pivots;
    step.columns = step.rank + others;
    std::copy_n(order, step.pivots, level.order.begin() + static_cast<std::ptrdiff_t>(step.first));
    double* const rows = level.values.data() + step.place;  // zeros so far
    for (Eigen::Index k = 0; k < step.rank; ++k)
        put(a.data() + order[k] * a.rows(), a.rows(), step.rank, 1, rows + k * step.rank, step.rank);
    put(a.data() + step.pivots * a.rows(), a.rows(), step.rank, others, rows + step.rank * step.rank, step.rank);
}

/// One node between its neighbours; `made` is the place for the rows that this leaves between them.
void eliminate_between(const Reduction& work, Elimination& step, const Edge& before, const Edge& after,
                       ChainLevel& level, Edge& made, double* place, MatrixPool& space, ShortRows& rest) {
    const ChainNode& own = work.nodes[static_cast<std::size_t>(step.node)];
    const Eigen::Index l = own.latents;
    const Eigen::Index l_left = work.nodes[static_cast<std::size_t>(step.left)].latents;
    const Eigen::Index l_right = work.nodes[static_cast<std::size_t>(step.right)].latents;
    const Eigen::Index both = l_left + l_right;
    Rows a = space.zero(before.rows + after.rows + own_rows(own), l + both + work.width);
    put_edge(before, 0, l, l_left, 0, l, work.width, a);
    put_edge(after, before.rows, 0, l, l + l_left, l_right, work.width, a);
    put_own(own, before.rows + after.rows, 0, work.width, a);

    Eigen::Index* order = space.order(std::max(l, both));
    step.rank = eliminate(a, 0, 0, own.limit, l, order);
    keep(a, order, step, level);
    const Eigen::Index between = eliminate(a, step.rank, l, space.zeros(both), both, order);
    made = {place, between, both + work.width, nullptr, nullptr};
    std::fill_n(place, between * (both + work.width), 0.0);
    put(a.data() + l * a.rows() + step.rank, a.rows(), between, both + work.width, place, between);
    const Eigen::Index from = step.rank + between;
    if (a.rows() > from) rest.add(a.bottomRightCorner(a.rows() - from, work.width));
}

/// The one or two nodes that are left.
void eliminate_last(const Reduction& work, ChainLevel& level, MatrixPool& space, ShortRows& rest) {
    const std::size_t first = work.left[0];
    const std::size_t second = work.left.back();
    const bool pair = work.left.size() == 2;
    const Eigen::Index l = work.nodes[first].latents;
    const Eigen::Index l_second = pair ? work.nodes[second].latents : 0;
    Eigen::Index rows = own_rows(work.nodes[first]) + (pair ? own_rows(work.nodes[second]) : 0);
    for (const Edge& edge : work.edge)
        rows += edge.rows;
    Rows a = space.zero(rows, l + l_second + work.width);
    Eigen::Index row = 0;
    for (std::size_t e = 0; e < work.edge.size(); ++e) {
        const Edge& edge = work.edge[e];
        const Eigen::Index l_from = e == 0 ? l : l_second;
        // A chain of one node closed in itself: both parts fall on the same columns.
        const Eigen::Index l_to = pair && e == 0 ? l_second : l;
        put_edge(edge, row, e == 0 ? 0 : l, l_from, pair && e == 0 ? l : 0, l_to, work.width, a);
        row += edge.rows;
    }
    Eigen::VectorXd limit(l + l_second);
    for (std::size_t i = 0; i < work.left.size(); ++i) {
        const ChainNode& node = work.nodes[work.left[i]];
        put_own(node, row, i == 0 ? 0 : l, work.width, a);
        std::copy_n(node.limit, node.latents, limit.data() + (i == 0 ? 0 : l));
        row += own_rows(node);
    }
    Elimination step;
    step.node = static_cast<std::ptrdiff_t>(first);
    step.partner = pair ? static_cast<std::ptrdiff_t>(second) : -1;
    step.pivots = l + l_second;
    level.values.resize(static_cast<std::size_t>(step.pivots * (step.pivots + work.width)));
    level.order.resize(static_cast<std::size_t>(step.pivots));
    Eigen::Index* order = space.order(step.pivots);
    step.rank = eliminate(a, 0, 0, limit.data(), step.pivots, order);
    keep(a, order, step, level);
    level.steps.push_back(step);
    if (a.rows() > step.rank) rest.add(a.bottomRightCorner(a.rows() - step.rank, work.width));
}

/// What is left of a part of a chain: the rows between its ends, and their own.
void keep_ends(const Reduction& work, MatrixPool& space, ChainFactor& chain) {
    const ChainNode& first = work.nodes[work.left[0]];
    const ChainNode& last = work.nodes[work.left[1]];
    Rows between = space.zero(work.edge[0].rows, first.latents + last.latents + work.width);
    put_edge(work.edge[0], 0, 0, first.latents, first.latents, last.latents, work.width, between);
    chain.ends = between;
    for (std::size_t i = 0; i < 2; ++i) {
        const ChainNode& node = i == 0 ? first : last;
        Rows own = space.zero(own_rows(node), node.latents + work.width);
        put_own(node, 0, 0, work.width, own);
        chain.own_of_ends[i] = own;
    }
}

/// Lays out the elimination of every second node between its neighbours.
/// @return where the rows that each leaves begin in the next pool
std::vector<std::size_t> lay_out(Reduction& work, std::size_t count, ChainLevel& level) {
    const std::size_t size = work.left.size();
    level.steps.resize(count);
    std::vector<std::size_t> place(count);
    std::size_t values = 0;
    std::size_t order = 0;
    std::size_t pool = 0;
    for (std::size_t k = 0; k < count; ++k) {
        Elimination& step = level.steps[k];
        const std::size_t i = 2 * k + 1;
        step.node = static_cast<std::ptrdiff_t>(work.left[i]);
        step.left = static_cast<std::ptrdiff_t>(work.left[i - 1]);
        step.right = static_cast<std::ptrdiff_t>(work.left[(i + 1) % size]);
        step.pivots = work.nodes[work.left[i]].latents;
        step.place = values;
        step.first = order;
        place[k] = pool;
        const Eigen::Index both = work.nodes[work.left[i - 1]].latents + work.nodes[work.left[(i + 1) % size]].latents;
        values += static_cast<std::size_t>(step.pivots * (step.pivots + both + work.width));
        order += static_cast<std::size_t>(step.pivots);
        pool += static_cast<std::size_t>(both * (both + work.width));
    }
    level.values.resize(values);
    level.order.resize(order);
    work.next_pool.resize(pool);
    return place;
}

/// The nodes that stay after `count` eliminations, with the edges made and those that no elimination touched.
void carry_over(Reduction& work, std::size_t count, bool cyclic, std::vector<Edge> edges) {
    const std::size_t size = work.left.size();
    std::vector<std::size_t> left;
    left.reserve(size / 2 + 2);
    for (std::size_t i = 0; i < size; i += 2) {
        left.push_back(work.left[i]);
        if (i / 2 < count) continue;
        // The end of an even open chain stays with the node before it; so does an odd ring's last link.
        if (!cyclic && i + 1 < size) left.push_back(work.left[i + 1]);
    }
    // What such a link holds moves along with the pool.
    for (std::size_t e = 2 * count; e < work.edge.size(); ++e) {
        edges.push_back(work.edge[e]);
        if (edges.back().from != nullptr) continue;
        // At most one edge stays, so that the pool is not moved under a reference twice.
        const auto cells = static_cast<std::size_t>(edges.back().rows * edges.back().columns);
        const std::size_t at = work.next_pool.size();
        const double* old = work.next_pool.data();
        work.next_pool.resize(at + cells);
        std::copy_n(edges.back().values, cells, work.next_pool.begin() + static_cast<std::ptrdiff_t>(at));
        for (std::size_t k = 0; k + 1 < edges.size(); ++k)
            if (edges[k].from == nullptr) edges[k].values = work.next_pool.data() + (edges[k].values - old);
        edges.back().values = work.next_pool.data() + at;
    }
    work.left = std::move(left);
    work.edge = std::move(edges);
    std::swap(work.pool, work.next_pool);
}

/// Every second node that has a neighbour on both sides.
ChainLevel reduce(Reduction& work, bool cyclic, ShortRows& rest) {
    const std::size_t count = cyclic ? work.left.size() / 2 : (work.left.size() - 1) / 2;
    ChainLevel level;
    const std::vector<std::size_t> place = lay_out(work, count, level);
    std::vector<Edge> edges(count);
    std::vector<Eigen::MatrixXd> rests(pieces_of(count));
    for_pieces(count, [&](std::size_t begin, std::size_t end, std::size_t piece) {
        MatrixPool space;
        ShortRows own(work.width);
        for (std::size_t k = begin; k < end; ++k)
            eliminate_between(work, level.steps[k], work.edge[2 * k], work.edge[2 * k + 1], level, edges[k],
                              work.next_pool.data() + place[k], space, own);
        rests[piece] = own.triangle();
    });
    for (const Eigen::MatrixXd& rows : rests)
        rest.add(rows);
    carry_over(work, count, cyclic, std::move(edges));
    return level;
}

}  // namespace

ChainFactor factorise_chain(const std::vector<ChainNode>& nodes, bool cyclic, Eigen::Index parameters, bool part) {
    ChainFactor chain;
    chain.cyclic = cyclic;
    Reduction work{nodes, parameters + 1, {}, {}, {}, {}};
    chain.block.reserve(nodes.size());
    chain.latents.reserve(nodes.size());
    work.left.reserve(nodes.size());
    work.edge.reserve(nodes.size());
    for (std::size_t i = 0; i < nodes.size(); ++i) {
        chain.block.push_back(nodes[i].block);
        chain.latents.push_back(nodes[i].latents);
        work.left.push_back(i);
        if (!cyclic && i + 1 == nodes.size()) continue;
        Edge edge;
        edge.from = &nodes[i];
        edge.to = &nodes[(i + 1) % nodes.size()];
        if (nodes[i].link != nullptr) {
            edge.values = nodes[i].link->data();
            edge.rows = nodes[i].link->rows();
            edge.columns = nodes[i].link->cols();
        }
        work.edge.push_back(edge);
    }
    ShortRows rest(work.width);
    while (work.left.size() > 2)
        chain.levels.push_back(reduce(work, cyclic, rest));
    MatrixPool space;
    if (part) {
        keep_ends(work, space, chain);
    } else {
        chain.levels.emplace_back();
        eliminate_last(work, chain.levels.back(), space, rest);
    }
    chain.rest = rest.triangle();
    return chain;
}

}  // namespace orbid::estimator
