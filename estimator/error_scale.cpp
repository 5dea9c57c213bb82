#include "estimator/error_scale.hpp"

#include <algorithm>
#include <cmath>

#include <Eigen/Cholesky>

#include "estimator/coordinate.hpp"

namespace orbid::estimator {

namespace {

/// A = sum_i in g of (L^-T columns)_i (L columns)_i^T over the rows of one block, per channel.
struct ChannelProducts {
    const Eigen::MatrixXd& left;   ///< L^-T Q (or Q itself)
    const Eigen::MatrixXd& right;  ///< L Q (or Q itself)
};

Eigen::MatrixXd symmetric_product(const ChannelProducts& products, const std::vector<int>& channel, int g) {
    const Eigen::Index columns = products.left.cols();
    Eigen::MatrixXd k = Eigen::MatrixXd::Zero(columns, columns);
    for (std::size_t i = 0; i < channel.size(); ++i)
        if (channel[i] == g)
            k.noalias() += products.right.row(static_cast<Eigen::Index>(i)).transpose() *
                           products.left.row(static_cast<Eigen::Index>(i));
    return 0.5 * (k + k.transpose());
}

}  // namespace

ScalePoint evaluate_scales(const ScaleProblem& problem, const Eigen::VectorXd& x) {
    const Eigen::Index channels = x.size();
    const Eigen::Index rank = problem.prior_gradient.size();
    const Eigen::VectorXd scale = x.array().exp();
    std::vector<BlockTriangle> triangles;
    std::vector<Eigen::MatrixXd> rows;
    triangles.reserve(problem.rows.size());
    rows.reserve(problem.rows.size());
    for (const BlockRows& block : problem.rows) {
        rows.push_back(whitened(block, scale));
        triangles.push_back(block_triangle(rows.back(), block.latents));
    }
    const Arrow arrow = factorise(std::move(triangles), rank);
    const Condensed condensed = condense(arrow, 0.0);

    // The decided parameters with their prior: triangle R and best step y.
    Eigen::MatrixXd stacked(rank + problem.prior_rows.rows(), rank + 1);
    stacked << condensed.r, condensed.rhs, problem.prior_rows, Eigen::VectorXd::Zero(problem.prior_rows.rows());
    const Eigen::MatrixXd factor = upper_triangle(std::move(stacked));
    ScalePoint point;
    point.triangle = factor.topLeftCorner(rank, rank);
    const auto r = point.triangle.triangularView<Eigen::Upper>();

    Eigen::VectorXd y = Eigen::VectorXd::Zero(rank);
    std::vector<Eigen::VectorXd> d_z;
    if (problem.profile) {
        y = problem.prior_gradient;
        point.triangle.transpose().triangularView<Eigen::Lower>().solveInPlace(y);
        y = -(y + factor.topRightCorner(rank, 1));
        r.solveInPlace(y);
        d_z = latent_steps(arrow, condensed, y);
        point.value += problem.prior_gradient.dot(y) + 0.5 * (problem.prior_rows * y).squaredNorm();
    }

    point.gradient = problem.set->count;
    point.fit = Eigen::VectorXd::Zero(channels);
    point.information = problem.set->information;
    point.value += problem.set->count.dot(x);
    if (problem.restricted) point.value += point.triangle.diagonal().array().abs().log().sum();

    std::vector<Eigen::MatrixXd> common(static_cast<std::size_t>(channels), Eigen::MatrixXd::Zero(rank, rank));
    for (std::size_t b = 0; b < problem.rows.size(); ++b) {
        const BlockRows& block = problem.rows[b];
        const Eigen::Index l = block.latents;
        Eigen::VectorXd w = rows[b].rightCols(1);
        if (problem.profile) w += rows[b].leftCols(l) * d_z[b] + rows[b].middleCols(l, rank) * y;
        point.value += 0.5 * w.squaredNorm();

        // Orthonormal columns Q = [A_z A] R^-1, latent part first. Dead latent columns are zero in effect.
        Eigen::MatrixXd basis = rows[b].leftCols(l + rank);
        for (Eigen::Index j = 0; j < l; ++j) {
            if (arrow.blocks[b].dead[static_cast<std::size_t>(j)]) basis.col(j).setZero();
            point.value += std::log(std::abs(condensed.top[b](j, j)));
        }
        if (l > 0) {
            Eigen::MatrixXd q_z = basis.leftCols(l);
            condensed.top[b].leftCols(l).triangularView<Eigen::Upper>().solveInPlace<Eigen::OnTheRight>(q_z);
            basis.leftCols(l) = q_z;
            basis.rightCols(rank) -= q_z * condensed.top[b].middleCols(l, rank);
        }
        if (rank > 0) {
            Eigen::MatrixXd q_theta = basis.rightCols(rank);
            r.solveInPlace<Eigen::OnTheRight>(q_theta);
            basis.rightCols(rank) = q_theta;
        }
        Eigen::MatrixXd left = basis;
        Eigen::MatrixXd right = basis;
        Eigen::VectorXd left_w = w;
        Eigen::VectorXd right_w = w;
        if (block.cholesky->size() > 0) {
            const auto lower = block.cholesky->triangularView<Eigen::Lower>();
            block.cholesky->transpose().triangularView<Eigen::Upper>().solveInPlace(left);
            block.cholesky->transpose().triangularView<Eigen::Upper>().solveInPlace(left_w);
            right = lower * basis;
            right_w = lower * w;
        }
        const Eigen::Index counted = problem.restricted ? l + rank : l;
        std::vector<int> present = block.channel;
        std::sort(present.begin(), present.end());
        present.erase(std::unique(present.begin(), present.end()), present.end());
        for (std::size_t i = 0; i < block.channel.size(); ++i) {
            const auto row = static_cast<Eigen::Index>(i);
            const double fit = left_w[row] * right_w[row];
            point.fit[block.channel[i]] += fit;
            point.gradient[block.channel[i]] -= fit + left.row(row).head(counted).dot(right.row(row).head(counted));
        }
        std::vector<Eigen::MatrixXd> k;
        for (const int g : present)
            k.push_back(symmetric_product({left, right}, block.channel, g));
        for (std::size_t i = 0; i < present.size(); ++i) {
            common[static_cast<std::size_t>(present[i])] += k[i].bottomRightCorner(rank, rank);
            for (std::size_t j = 0; j < present.size(); ++j) {
                double product = k[i].topLeftCorner(l, l).cwiseProduct(k[j].topLeftCorner(l, l)).sum();
                if (problem.restricted)
                    product += 2.0 * k[i].topRightCorner(l, rank).cwiseProduct(k[j].topRightCorner(l, rank)).sum();
                point.information(present[i], present[j]) -= 2.0 * product;
            }
        }
    }
    if (problem.restricted)
        for (Eigen::Index g = 0; g < channels; ++g)
            for (Eigen::Index h = 0; h < channels; ++h)
                point.information(g, h) -=
                    2.0 * common[static_cast<std::size_t>(g)].cwiseProduct(common[static_cast<std::size_t>(h)]).sum();
    point.share = std::move(common);
    point.data_gradient = point.gradient;
    const Coordinate log_scale{Scale::log};
    for (Eigen::Index g = 0; g < channels; ++g) {
        if (!problem.free[static_cast<std::size_t>(g)]) continue;
        const PriorTerm term = log_scale.term(problem.priors[static_cast<std::size_t>(g)], x[g]);
        point.value += term.value;
        point.gradient[g] += term.gradient;
        point.information(g, g) += term.curvature;
    }
    return point;
}

ScaleMinimum minimise_scales(const ScaleProblem& problem, const Eigen::VectorXd& start, const Eigen::VectorXd& floor,
                             const Eigen::VectorXd& ceiling) {
    const Eigen::Index channels = start.size();
    ScaleMinimum minimum;
    minimum.x = start;
    for (Eigen::Index g = 0; g < channels; ++g)
        if (problem.free[static_cast<std::size_t>(g)]) minimum.x[g] = std::clamp(start[g], floor[g], ceiling[g]);
    minimum.at_floor.assign(static_cast<std::size_t>(channels), false);
    ScalePoint point = evaluate_scales(problem, minimum.x);
    minimum.before = minimum.after = point.value;
    // Fixed-point steps gain a constant factor each, six decades take some dozens; scoring then needs a few.
    constexpr int step_limit = 200;
    for (int iteration = 0; iteration < step_limit; ++iteration) {
        std::vector<Eigen::Index> free;
        for (Eigen::Index g = 0; g < channels; ++g) {
            const auto index = static_cast<std::size_t>(g);
            minimum.at_floor[index] = problem.free[index] && minimum.x[g] <= floor[g] && point.gradient[g] > 0.0;
            const bool at_ceiling = minimum.x[g] >= ceiling[g] && point.gradient[g] < 0.0;
            if (problem.free[index] && !minimum.at_floor[index] && !at_ceiling) free.push_back(g);
        }
        minimum.distance = 0.0;
        if (free.empty()) return minimum;
        const auto count = static_cast<Eigen::Index>(free.size());
        Eigen::MatrixXd information(count, count);
        Eigen::VectorXd gradient(count);
        bool far = false;
        Eigen::VectorXd fixed_point(count);
        for (Eigen::Index i = 0; i < count; ++i) {
            const Eigen::Index g = free[static_cast<std::size_t>(i)];
            gradient[i] = point.gradient[g];
            for (Eigen::Index j = 0; j < count; ++j)
                information(i, j) = point.information(g, free[static_cast<std::size_t>(j)]);
            // (M10) solved for the factor on s^2 with its trace t held: fit / (n - t), exact for one channel; where a
            // coupled shape makes that meaningless, (fit + t) / n, which is always positive for one channel.
            const double left_over = point.data_gradient[g] + point.fit[g];
            const double ratio = point.fit[g] > 0.0 && left_over > 1e-3
                                     ? point.fit[g] / left_over
                                     : 1.0 - point.data_gradient[g] / problem.set->count[g];
            fixed_point[i] = 0.5 * std::log(std::max(ratio, 1e-12));
            far = far || std::abs(fixed_point[i]) > 0.5;
        }
        const Eigen::LDLT<Eigen::MatrixXd> factor(information);
        const bool definite = factor.info() == Eigen::Success && factor.isPositive() &&
                              factor.vectorD().minCoeff() > 1e-10 * factor.vectorD().maxCoeff();
        Eigen::VectorXd step = definite && !far ? Eigen::VectorXd(-factor.solve(gradient)) : fixed_point;
        minimum.distance = 0.0;
        for (Eigen::Index i = 0; i < count; ++i)
            minimum.distance =
                std::max(minimum.distance, std::abs(gradient[i]) / std::sqrt(std::max(information(i, i), 1e-300)));
        // Below this many sds of ln s no figure of a result changes.
        if (minimum.distance < 1e-12) return minimum;

        bool accepted = false;
        for (int halving = 0; halving < 30 && !accepted; ++halving, step *= 0.3) {
            Eigen::VectorXd trial = minimum.x;
            for (Eigen::Index i = 0; i < count; ++i) {
                const Eigen::Index g = free[static_cast<std::size_t>(i)];
                trial[g] = std::clamp(trial[g] + std::clamp(step[i], -5.0, 5.0), floor[g], ceiling[g]);
            }
            const Eigen::VectorXd moved = trial - minimum.x;
            if (!(moved.lpNorm<Eigen::Infinity>() > 0.0)) break;
            ScalePoint next = evaluate_scales(problem, trial);
            // Close by, the difference of two values is lost in their rounding; the trapezoidal rule of the
            // gradient keeps it (relative error ~ |step|).
            const double change = moved.lpNorm<Eigen::Infinity>() < 1e-3
                                      ? 0.5 * (point.gradient + next.gradient).dot(moved)
                                      : next.value - point.value;
            if (!(change < 0.0)) continue;
            minimum.x = trial;
            minimum.after += change;
            point = std::move(next);
            accepted = true;
            ++minimum.steps;
        }
        if (!accepted) return minimum;
    }
    return minimum;
}

}  // namespace orbid::estimator
