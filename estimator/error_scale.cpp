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

namespace {

/// Steps of ln s worth trying, as changes of the free channels.
std::vector<Eigen::VectorXd> far_steps(const ScaleProblem& problem, const ScalePoint& point,
                                       const std::vector<Eigen::Index>& free) {
    const auto count = static_cast<Eigen::Index>(free.size());
    Eigen::VectorXd own(count);
    double fit = 0.0;
    double left = 0.0;
    for (Eigen::Index i = 0; i < count; ++i) {
        const Eigen::Index g = free[static_cast<std::size_t>(i)];
        // (M10) solved for the factor on s^2 with its trace t held: fit / (n - t), exact for one channel; where a
        // coupled shape makes that meaningless, (fit + t) / n, which is always positive for one channel.
        const double left_over = point.data_gradient[g] + point.fit[g];
        const double ratio = point.fit[g] > 0.0 && left_over > 1e-3
                                 ? point.fit[g] / left_over
                                 : 1.0 - point.data_gradient[g] / problem.set->count[g];
        own[i] = 0.5 * std::log(std::max(ratio, 1e-12));
        fit += point.fit[g];
        left += left_over;
    }
    std::vector<Eigen::VectorXd> steps{own};
    // The same for all channels together: exact where a shape ties them to each other.
    if (fit > 0.0 && left > 1e-3) steps.push_back(Eigen::VectorXd::Constant(count, 0.5 * std::log(fit / left)));
    return steps;
}

/// Restriction of a matrix to the free channels.
Eigen::MatrixXd restricted_to(const Eigen::MatrixXd& matrix, const std::vector<Eigen::Index>& free) {
    const auto count = static_cast<Eigen::Index>(free.size());
    Eigen::MatrixXd part(count, count);
    for (Eigen::Index i = 0; i < count; ++i)
        for (Eigen::Index j = 0; j < count; ++j)
            part(i, j) = matrix(free[static_cast<std::size_t>(i)], free[static_cast<std::size_t>(j)]);
    return part;
}

/// Secant (BFGS) update of a Hessian: H s = y afterwards; skipped where y^T s > 0 does not hold.
void update(Eigen::MatrixXd& hessian, const Eigen::VectorXd& s, const Eigen::VectorXd& y) {
    const Eigen::VectorXd h_s = hessian * s;
    const double curvature = y.dot(s);
    const double expected = s.dot(h_s);
    if (!(curvature > 1e-8 * expected)) return;
    hessian += y * y.transpose() / curvature - h_s * h_s.transpose() / expected;
}

}  // namespace

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
    std::vector<Eigen::Index> former_free;
    Eigen::MatrixXd hessian;
    // Six decades take a few fixed-point steps, secant steps then converge superlinearly; two dozen are usual at most.
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
        Eigen::VectorXd gradient(count);
        for (Eigen::Index i = 0; i < count; ++i) {
            const Eigen::Index g = free[static_cast<std::size_t>(i)];
            gradient[i] = point.gradient[g];
            const double information = std::max(point.information(g, g), 1e-300);
            minimum.distance = std::max(minimum.distance, std::abs(gradient[i]) / std::sqrt(information));
        }
        // Below this many sds of ln s no figure of a result changes.
        if (minimum.distance < 1e-12) return minimum;

        if (free != former_free) hessian = restricted_to(point.information, free);
        former_free = free;
        const Eigen::LDLT<Eigen::MatrixXd> factor(hessian);
        const bool definite = factor.info() == Eigen::Success && factor.isPositive() &&
                              factor.vectorD().minCoeff() > 1e-10 * factor.vectorD().maxCoeff();
        std::vector<Eigen::VectorXd> steps;
        if (definite) steps.emplace_back(-factor.solve(gradient));
        // Expected information says little about a minimum that is many sds away.
        if (!definite || minimum.distance > 1.0)
            for (Eigen::VectorXd& step : far_steps(problem, point, free))
                steps.push_back(std::move(step));

        const auto trial_of = [&](const Eigen::VectorXd& step) {
            Eigen::VectorXd trial = minimum.x;
            for (Eigen::Index i = 0; i < count; ++i) {
                const Eigen::Index g = free[static_cast<std::size_t>(i)];
                trial[g] = std::clamp(trial[g] + std::clamp(step[i], -5.0, 5.0), floor[g], ceiling[g]);
            }
            return trial;
        };
        // Close by, the difference of two values is lost in their rounding; the trapezoidal rule of the gradient keeps
        // it (relative error ~ |step|).
        const auto change_to = [&](const Eigen::VectorXd& trial, const ScalePoint& next) {
            const Eigen::VectorXd moved = trial - minimum.x;
            return moved.lpNorm<Eigen::Infinity>() < 1e-3 ? 0.5 * (point.gradient + next.gradient).dot(moved)
                                                          : next.value - point.value;
        };
        Eigen::VectorXd best;
        ScalePoint best_point;
        double best_change = 0.0;
        for (int shortening = 0; shortening < 30 && !(best_change < 0.0); ++shortening) {
            for (Eigen::VectorXd& step : steps) {
                Eigen::VectorXd trial = trial_of(step);
                step *= 0.3;
                if (!((trial - minimum.x).lpNorm<Eigen::Infinity>() > 0.0)) continue;
                ScalePoint next = evaluate_scales(problem, trial);
                const double change = change_to(trial, next);
                if (!(change < best_change)) continue;
                best_change = change;
                best = std::move(trial);
                best_point = std::move(next);
            }
        }
        if (!(best_change < 0.0)) return minimum;
        Eigen::VectorXd s(count);
        Eigen::VectorXd y(count);
        for (Eigen::Index i = 0; i < count; ++i) {
            const Eigen::Index g = free[static_cast<std::size_t>(i)];
            s[i] = best[g] - minimum.x[g];
            y[i] = best_point.gradient[g] - point.gradient[g];
        }
        // A long step says nothing about the curvature where it ends.
        if (s.lpNorm<Eigen::Infinity>() > 0.5)
            hessian = restricted_to(best_point.information, free);
        else
            update(hessian, s, y);
        minimum.x = std::move(best);
        minimum.after += best_change;
        point = std::move(best_point);
        ++minimum.steps;
    }
    return minimum;
}

}  // namespace orbid::estimator
