#pragma once

#include <algorithm>
#include <vector>

#include "estimator/algebra/chain.hpp"

/// Rows of chains put together in matrices as small as a state.
namespace orbid::estimator::detail {

using Rows = Eigen::Map<Eigen::MatrixXd>;

/// Rows on two neighbouring nodes of the moment, [left | right | common]: an original link, or a place in a pool.
struct Edge {
    const double* values = nullptr;
    Eigen::Index rows = 0;
    Eigen::Index columns = 0;
    const ChainNode* from = nullptr;  ///< of an original link
    const ChainNode* to = nullptr;
};

/// Small matrices one after the other in the same memory.
class MatrixPool {
public:
    Rows zero(Eigen::Index rows, Eigen::Index columns) {
        const auto size = static_cast<std::size_t>(rows * columns);
        if (values_.size() < size) values_.resize(2 * size);
        std::fill_n(values_.begin(), size, 0.0);
        return {values_.data(), rows, columns};
    }
    Eigen::Index* order(Eigen::Index count) {
        if (order_.size() < static_cast<std::size_t>(count)) order_.resize(2 * static_cast<std::size_t>(count));
        return order_.data();
    }
    const double* zeros(Eigen::Index count) {
        if (zeros_.size() < static_cast<std::size_t>(count)) zeros_.resize(2 * static_cast<std::size_t>(count), 0.0);
        return zeros_.data();
    }

private:
    std::vector<double> values_;
    std::vector<double> zeros_;
    std::vector<Eigen::Index> order_;
};

/// Columns of dead states carry nothing.
template <class Matrix>
void clear_dead(Matrix&& columns, const ChainNode& node) {
    if (node.dead == nullptr) return;
    for (Eigen::Index j = 0; j < node.latents; ++j)
        if ((*node.dead)[static_cast<std::size_t>(j)]) columns.col(j).setZero();
}

inline Eigen::Index own_rows(const ChainNode& node) {
    return node.own->rows() + (node.alone != nullptr ? node.alone->rows() : 0) +
           (node.norm != nullptr ? node.latents : 0);
}

/// Plain loops below: the matrices are as small as a state, and calls for general ones cost more than the copies.
inline void put(const double* from, Eigen::Index from_stride, Eigen::Index rows, Eigen::Index columns, double* to,
                Eigen::Index to_stride) {
    for (Eigen::Index j = 0; j < columns; ++j)
        for (Eigen::Index i = 0; i < rows; ++i)
            to[j * to_stride + i] += from[j * from_stride + i];
}

/// A node's own rows, its states from column `first`, the common columns at the end.
inline void put_own(const ChainNode& node, Eigen::Index row, Eigen::Index first, Eigen::Index width, Rows& a) {
    const Eigen::Index begin = row;
    const Eigen::Index common = a.cols() - width;
    for (const Eigen::MatrixXd* rows : {node.own, node.alone}) {
        if (rows == nullptr) continue;
        const Eigen::Index m = rows->rows();
        put(rows->data(), m, m, node.latents, a.data() + first * a.rows() + row, a.rows());
        put(rows->data() + node.latents * m, m, m, width, a.data() + common * a.rows() + row, a.rows());
        row += m;
    }
    for (Eigen::Index k = 0; node.norm != nullptr && k < node.latents; ++k)
        if (node.dead == nullptr || !(*node.dead)[static_cast<std::size_t>(k)])
            a(row + k, first + k) = node.damping * (*node.norm)[k];
    if (node.dead != nullptr) clear_dead(a.block(begin, first, row - begin, node.latents), node);
}

/// The rows of an edge, its left states from column `left`, the right ones from `right`; they are added.
inline void put_edge(const Edge& edge, Eigen::Index row, Eigen::Index left, Eigen::Index l_left, Eigen::Index right,
                     Eigen::Index l_right, Eigen::Index width, Rows& a) {
    const Eigen::Index m = edge.rows;
    if (m == 0) return;
    double* const to = a.data() + row;
    put(edge.values, m, m, l_left, to + left * a.rows(), a.rows());
    put(edge.values + l_left * m, m, m, l_right, to + right * a.rows(), a.rows());
    put(edge.values + (l_left + l_right) * m, m, m, width, to + (a.cols() - width) * a.rows(), a.rows());
    if (edge.from == nullptr) return;
    if (edge.from->dead != nullptr) clear_dead(a.block(row, left, m, l_left), *edge.from);
    if (edge.to->dead != nullptr) clear_dead(a.block(row, right, m, l_right), *edge.to);
}

}  // namespace orbid::estimator::detail
