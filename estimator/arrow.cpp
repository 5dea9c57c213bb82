#include "estimator/arrow.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include <Eigen/QR>

namespace orbid::estimator {

namespace {

/// A latent column whose part independent of the columns before it is below this share of it carries rounding only.
constexpr double dead_share = 1e-13;

}  // namespace

Eigen::MatrixXd upper_triangle(Eigen::MatrixXd a) {
    const Eigen::Index columns = a.cols();
    const Eigen::Index rows = std::min(a.rows(), columns);
    Eigen::MatrixXd result = Eigen::MatrixXd::Zero(columns, columns);
    if (rows == 0) return result;
    // Householder reflections are row-wise stable when heavy rows come first; only small stacks mix weights widely,
    // and there the order costs nothing.
    if (a.rows() <= 4 * columns + 16) {
        std::vector<Eigen::Index> order(static_cast<std::size_t>(a.rows()));
        std::iota(order.begin(), order.end(), Eigen::Index{0});
        const Eigen::VectorXd weight = a.rowwise().lpNorm<Eigen::Infinity>();
        std::stable_sort(order.begin(), order.end(),
                         [&weight](Eigen::Index i, Eigen::Index j) { return weight[i] > weight[j]; });
        Eigen::MatrixXd sorted(a.rows(), columns);
        for (Eigen::Index i = 0; i < a.rows(); ++i)
            sorted.row(i) = a.row(order[static_cast<std::size_t>(i)]);
        a = std::move(sorted);
    }
    const Eigen::HouseholderQR<Eigen::Ref<Eigen::MatrixXd>> qr(a);
    result.topRows(rows) = qr.matrixQR().topRows(rows).triangularView<Eigen::Upper>();
    return result;
}

BlockTriangle block_triangle(Eigen::MatrixXd rows, Eigen::Index latents) {
    BlockTriangle block;
    block.latents = latents;
    block.norm = rows.leftCols(latents).colwise().norm().transpose();
    block.dead.assign(static_cast<std::size_t>(latents), false);
    const Eigen::Index columns = rows.cols();
    block.triangle = upper_triangle(latents == 0 ? std::move(rows) : rows);
    bool any_dead = false;
    for (Eigen::Index j = 0; j < latents; ++j) {
        if (std::abs(block.triangle(j, j)) > dead_share * block.norm[j]) continue;
        block.dead[static_cast<std::size_t>(j)] = true;
        any_dead = true;
    }
    if (!any_dead) return block;
    // The dead columns leave the problem; a unit row in their place keeps the triangle regular and their step zero.
    const Eigen::Index count = std::count(block.dead.begin(), block.dead.end(), true);
    Eigen::MatrixXd extended = Eigen::MatrixXd::Zero(rows.rows() + count, columns);
    extended.topRows(rows.rows()) = rows;
    Eigen::Index extra = rows.rows();
    for (Eigen::Index j = 0; j < latents; ++j) {
        if (!block.dead[static_cast<std::size_t>(j)]) continue;
        extended.col(j).setZero();
        extended(extra++, j) = 1.0;
        block.norm[j] = 1.0;
    }
    block.triangle = upper_triangle(std::move(extended));
    return block;
}

Arrow factorise(std::vector<BlockTriangle> blocks, Eigen::Index parameters) {
    Arrow arrow;
    arrow.parameters = parameters;
    const Eigen::Index width = parameters + 1;
    Eigen::MatrixXd stacked(static_cast<Eigen::Index>(blocks.size()) * width, width);
    for (std::size_t b = 0; b < blocks.size(); ++b)
        stacked.middleRows(static_cast<Eigen::Index>(b) * width, width) =
            blocks[b].triangle.bottomRightCorner(width, width);
    arrow.pool = upper_triangle(std::move(stacked));
    arrow.blocks = std::move(blocks);
    return arrow;
}

Condensed condense(const Arrow& arrow, double mu) {
    const Eigen::Index width = arrow.parameters + 1;
    Condensed condensed;
    condensed.top.reserve(arrow.blocks.size());
    Eigen::MatrixXd pool = arrow.pool;
    if (mu > 0.0) {
        Eigen::Index latents = 0;
        for (const BlockTriangle& block : arrow.blocks)
            latents += block.latents;
        Eigen::MatrixXd stacked(width + latents, width);
        stacked.topRows(width) = arrow.pool;
        Eigen::Index row = width;
        for (const BlockTriangle& block : arrow.blocks) {
            const Eigen::Index l = block.latents;
            if (l == 0) {
                condensed.top.emplace_back(0, width);
                continue;
            }
            Eigen::MatrixXd damped = Eigen::MatrixXd::Zero(2 * l, l + width);
            damped.topRows(l) = block.triangle.topRows(l);
            damped.bottomLeftCorner(l, l).diagonal() = std::sqrt(mu) * block.norm;
            const Eigen::HouseholderQR<Eigen::Ref<Eigen::MatrixXd>> qr(damped);
            Eigen::MatrixXd factor = qr.matrixQR();
            factor.triangularView<Eigen::StrictlyLower>().setZero();
            condensed.top.push_back(factor.topRows(l));
            stacked.middleRows(row, l) = factor.bottomRightCorner(l, width);
            row += l;
        }
        pool = upper_triangle(std::move(stacked));
    } else {
        for (const BlockTriangle& block : arrow.blocks)
            condensed.top.push_back(block.triangle.topRows(block.latents));
    }
    condensed.r = pool.topLeftCorner(arrow.parameters, arrow.parameters);
    condensed.rhs = pool.topRightCorner(arrow.parameters, 1);
    condensed.rest = std::abs(pool(arrow.parameters, arrow.parameters));
    return condensed;
}

std::vector<Eigen::VectorXd> latent_steps(const Arrow& arrow, const Condensed& condensed, const Eigen::VectorXd& d) {
    std::vector<Eigen::VectorXd> steps(arrow.blocks.size());
    for (std::size_t b = 0; b < arrow.blocks.size(); ++b) {
        const Eigen::Index l = arrow.blocks[b].latents;
        if (l == 0) {
            steps[b].resize(0);
            continue;
        }
        const Eigen::MatrixXd& top = condensed.top[b];
        steps[b] = -(top.rightCols(1) + top.middleCols(l, arrow.parameters) * d);
        top.leftCols(l).triangularView<Eigen::Upper>().solveInPlace(steps[b]);
    }
    return steps;
}

ModelChange model_change(const Arrow& arrow, const Eigen::VectorXd& d, const std::vector<Eigen::VectorXd>& d_z) {
    ModelChange change;
    for (std::size_t b = 0; b < arrow.blocks.size(); ++b) {
        const BlockTriangle& block = arrow.blocks[b];
        const Eigen::VectorXd moved = block.triangle.leftCols(block.latents) * d_z[b] +
                                      block.triangle.middleCols(block.latents, arrow.parameters) * d;
        change.linear += moved.dot(block.triangle.rightCols(1).col(0));
        change.quadratic += moved.squaredNorm();
    }
    return change;
}

}  // namespace orbid::estimator
