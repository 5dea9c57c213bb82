#include "estimator/chain.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include <oneapi/tbb/parallel_for.h>

#include "estimator/triangle.hpp"

namespace orbid::estimator {

namespace {

/// Rows on two neighbouring nodes of the moment, [left | right | common].
struct Edge {
    Eigen::MatrixXd rows;
};

/// What is in work: the nodes left, in order, and the rows between each and the following one.
struct Reduction {
    const std::vector<ChainNode>& nodes;
    Eigen::Index width;  ///< q + 1
    std::vector<std::size_t> left;
    std::vector<Edge> edge;  ///< edge[i] between left[i] and left[i + 1] (cyclic: the last and the first)
};

/// Result of one elimination: the rows kept, what it leaves between the neighbours, and for the parameters alone.
struct Front {
    Elimination kept;
    Edge edge;
    Eigen::MatrixXd rest;
};

void cut_to_rank(Elimination& elimination, const Eigen::MatrixXd& a, const PivotedColumns& columns) {
    const Eigen::Index others = a.cols() - elimination.pivots;
    elimination.order = columns.order;
    elimination.rank = columns.rank;
    elimination.rows.resize(columns.rank, columns.rank + others);
    for (Eigen::Index k = 0; k < columns.rank; ++k)
        elimination.rows.col(k) = a.col(columns.order[static_cast<std::size_t>(k)]).head(columns.rank);
    elimination.rows.rightCols(others) = a.topRightCorner(columns.rank, others);
}

/// Rows that only the parameters are left in, made short.
Eigen::MatrixXd remainder(const Eigen::MatrixXd& a, Eigen::Index from, Eigen::Index width) {
    Eigen::MatrixXd rows = a.bottomRightCorner(std::max<Eigen::Index>(a.rows() - from, 0), width);
    if (rows.rows() > width) return upper_triangle(rows);
    return rows;
}

Front eliminate_between(const Reduction& work, std::size_t node, std::size_t left, std::size_t right,
                        const Edge& before, const Edge& after) {
    const ChainNode& own = work.nodes[node];
    const Eigen::Index l = own.latents;
    const Eigen::Index l_left = work.nodes[left].latents;
    const Eigen::Index l_right = work.nodes[right].latents;
    const Eigen::Index n_before = before.rows.rows();
    const Eigen::Index n_after = after.rows.rows();
    Eigen::MatrixXd a = Eigen::MatrixXd::Zero(n_before + n_after + own.own.rows(), l + l_left + l_right + work.width);
    a.block(0, 0, n_before, l) = before.rows.middleCols(l_left, l);
    a.block(0, l, n_before, l_left) = before.rows.leftCols(l_left);
    a.topRightCorner(n_before, work.width) = before.rows.rightCols(work.width);
    a.block(n_before, 0, n_after, l) = after.rows.leftCols(l);
    a.block(n_before, l + l_left, n_after, l_right) = after.rows.middleCols(l, l_right);
    a.block(n_before, l + l_left + l_right, n_after, work.width) = after.rows.rightCols(work.width);
    a.bottomLeftCorner(own.own.rows(), l) = own.own.leftCols(l);
    a.bottomRightCorner(own.own.rows(), work.width) = own.own.rightCols(work.width);

    Front front;
    front.kept.node = static_cast<std::ptrdiff_t>(node);
    front.kept.left = static_cast<std::ptrdiff_t>(left);
    front.kept.right = static_cast<std::ptrdiff_t>(right);
    front.kept.pivots = l;
    const PivotedColumns columns = eliminate(a, 0, 0, own.limit);
    cut_to_rank(front.kept, a, columns);
    const Eigen::Index both = l_left + l_right;
    const PivotedColumns between = eliminate(a, columns.rank, l, Eigen::VectorXd::Zero(both));
    front.edge.rows = a.block(columns.rank, l, between.rank, both + work.width);
    front.rest = remainder(a, columns.rank + between.rank, work.width);
    return front;
}

/// The one or two nodes that are left.
Front eliminate_last(const Reduction& work) {
    const std::size_t first = work.left[0];
    const std::size_t second = work.left.back();
    const bool pair = work.left.size() == 2;
    const Eigen::Index l = work.nodes[first].latents;
    const Eigen::Index l_second = pair ? work.nodes[second].latents : 0;
    Eigen::Index rows = work.nodes[first].own.rows() + (pair ? work.nodes[second].own.rows() : 0);
    for (const Edge& edge : work.edge)
        rows += edge.rows.rows();
    Eigen::MatrixXd a = Eigen::MatrixXd::Zero(rows, l + l_second + work.width);
    Eigen::Index row = 0;
    for (std::size_t e = 0; e < work.edge.size(); ++e) {
        const Eigen::MatrixXd& link = work.edge[e].rows;
        const Eigen::Index from = e == 0 ? 0 : l;
        const Eigen::Index to = pair && e == 0 ? l : 0;
        const Eigen::Index l_from = e == 0 ? l : l_second;
        const Eigen::Index l_to = link.cols() - l_from - work.width;
        // A chain of one node closed in itself: both parts fall on the same columns.
        a.block(row, from, link.rows(), l_from) += link.leftCols(l_from);
        a.block(row, to, link.rows(), l_to) += link.middleCols(l_from, l_to);
        a.block(row, l + l_second, link.rows(), work.width) = link.rightCols(work.width);
        row += link.rows();
    }
    Eigen::VectorXd limit(l + l_second);
    for (std::size_t i = 0; i < work.left.size(); ++i) {
        const ChainNode& node = work.nodes[work.left[i]];
        const Eigen::Index from = i == 0 ? 0 : l;
        a.block(row, from, node.own.rows(), node.latents) = node.own.leftCols(node.latents);
        a.block(row, l + l_second, node.own.rows(), work.width) = node.own.rightCols(work.width);
        limit.segment(from, node.latents) = node.limit;
        row += node.own.rows();
    }
    Front front;
    front.kept.node = static_cast<std::ptrdiff_t>(first);
    front.kept.partner = pair ? static_cast<std::ptrdiff_t>(second) : -1;
    front.kept.pivots = l + l_second;
    const PivotedColumns columns = eliminate(a, 0, 0, limit);
    cut_to_rank(front.kept, a, columns);
    front.rest = remainder(a, columns.rank, work.width);
    return front;
}

}  // namespace

ChainFactor factorise_chain(const std::vector<ChainNode>& nodes, bool cyclic, Eigen::Index parameters) {
    ChainFactor chain;
    chain.cyclic = cyclic;
    Reduction work{nodes, parameters + 1, {}, {}};
    for (std::size_t i = 0; i < nodes.size(); ++i) {
        chain.block.push_back(nodes[i].block);
        chain.latents.push_back(nodes[i].latents);
        work.left.push_back(i);
        if (cyclic || i + 1 < nodes.size()) work.edge.push_back({nodes[i].link});
    }
    std::vector<Eigen::MatrixXd> rests;
    while (work.left.size() > 2) {
        // Every second node that has a neighbour on both sides.
        const std::size_t size = work.left.size();
        const std::size_t count = cyclic ? size / 2 : (size - 1) / 2;
        std::vector<Front> fronts(count);
        const auto reduce = [&](std::size_t k) {
            const std::size_t i = 2 * k + 1;
            fronts[k] = eliminate_between(work, work.left[i], work.left[i - 1], work.left[(i + 1) % size],
                                          work.edge[i - 1], work.edge[i]);
        };
        // A front takes some microseconds at least: a few dozen are worth sharing.
        if (count >= 32)
            oneapi::tbb::parallel_for(std::size_t{0}, count, reduce);
        else
            for (std::size_t k = 0; k < count; ++k)
                reduce(k);
        std::vector<std::size_t> left;
        std::vector<Edge> edges;
        std::vector<Elimination> level;
        for (std::size_t i = 0; i < size; i += 2) {
            left.push_back(work.left[i]);
            if (i / 2 < count) {
                edges.push_back(std::move(fronts[i / 2].edge));
                level.push_back(std::move(fronts[i / 2].kept));
                rests.push_back(std::move(fronts[i / 2].rest));
            } else {
                // The end of an even open chain stays with the node before it; so does an odd ring's last link.
                if (i < work.edge.size()) edges.push_back(std::move(work.edge[i]));
                if (!cyclic && i + 1 < size) left.push_back(work.left[i + 1]);
            }
        }
        chain.levels.push_back(std::move(level));
        work.left = std::move(left);
        work.edge = std::move(edges);
    }
    Front last = eliminate_last(work);
    chain.levels.emplace_back();
    chain.levels.back().push_back(std::move(last.kept));
    rests.push_back(std::move(last.rest));
    Eigen::Index rows = 0;
    for (const Eigen::MatrixXd& rest : rests)
        rows += rest.rows();
    Eigen::MatrixXd stacked(rows, parameters + 1);
    rows = 0;
    for (const Eigen::MatrixXd& rest : rests) {
        stacked.middleRows(rows, rest.rows()) = rest;
        rows += rest.rows();
    }
    chain.rest = upper_triangle(stacked);
    return chain;
}

void solve_chain(const ChainFactor& chain, const Eigen::VectorXd& d, std::vector<Eigen::VectorXd>& z) {
    const Eigen::Index q = d.size();
    for (auto level = chain.levels.rbegin(); level != chain.levels.rend(); ++level) {
        for (const Elimination& step : *level) {
            const Eigen::MatrixXd& rows = step.rows;
            Eigen::VectorXd right = rows.rightCols(1) + rows.middleCols(rows.cols() - 1 - q, q) * d;
            Eigen::Index column = step.rank;
            for (const std::ptrdiff_t neighbour : {step.left, step.right}) {
                if (neighbour < 0) continue;
                const Eigen::VectorXd& known = z[chain.block[static_cast<std::size_t>(neighbour)]];
                right += rows.middleCols(column, known.size()) * known;
                column += known.size();
            }
            rows.leftCols(step.rank).triangularView<Eigen::Upper>().solveInPlace(right);
            Eigen::VectorXd solution = Eigen::VectorXd::Zero(step.pivots);
            for (Eigen::Index k = 0; k < step.rank; ++k)
                solution[step.order[static_cast<std::size_t>(k)]] = -right[k];
            const auto node = static_cast<std::size_t>(step.node);
            z[chain.block[node]] = solution.head(chain.latents[node]);
            if (step.partner >= 0) {
                const auto partner = static_cast<std::size_t>(step.partner);
                z[chain.block[partner]] = solution.tail(chain.latents[partner]);
            }
        }
    }
}

}  // namespace orbid::estimator
