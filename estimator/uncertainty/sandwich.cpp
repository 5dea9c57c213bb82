#include "estimator/uncertainty/sandwich.hpp"

#include <algorithm>
#include <cmath>

#include "models/arithmetic/eigenvalues.hpp"
#include "models/arithmetic/triangular_solve.hpp"

namespace orbid::estimator {

namespace {

/// A direction that one cluster alone decides is fitted by it: it has no residual left, and nothing to correct.
constexpr double alone = 1e-6;

/// The cluster of each standard row of a block: rows follow the records law by law.
std::vector<int> row_clusters(const ActiveBlock& block, const std::vector<NoiseModel>& laws,
                              const std::vector<int>& cluster) {
    if (block.parts().empty()) return cluster;
    std::vector<int> result;
    for (const LawPart& part : block.parts())
        for (int copy = 0; copy < laws[part.law].rows_per_record(); ++copy)
            for (const Eigen::Index record : part.records)
                result.push_back(cluster[static_cast<std::size_t>(record)]);
    return result;
}

}  // namespace

Sandwich::Sandwich(const std::vector<BlockRows>& rows, const BlockSet& set,
                   const std::vector<std::vector<int>>& cluster, const std::vector<NoiseModel>& laws,
                   const Eigen::VectorXd& psi, const Eigen::MatrixXd& triangle)
    : rank_(triangle.rows()), triangle_(triangle) {
    Eigen::MatrixXd meat = Eigen::MatrixXd::Zero(rank_, rank_);
    for (std::size_t b = 0; b < rows.size(); ++b) {
        const Eigen::Index l = rows[b].latents;
        const Eigen::MatrixXd whitened_rows = standard_rows(rows[b], laws, psi, Curvature::expected).rows;
        const std::vector<int> own_cluster = row_clusters(set.blocks[b], laws, cluster[b]);
        const BlockTriangle factor = block_triangle(whitened_rows, l);
        Eigen::MatrixXd q = whitened_rows.leftCols(l + rank_);
        for (Eigen::Index j = 0; j < l; ++j)
            if (factor.dead[static_cast<std::size_t>(j)]) q.col(j).setZero();
        if (l > 0) {
            Eigen::MatrixXd q_z = q.leftCols(l);
            models::divide_by_upper_in_place(q_z, factor.triangle.topLeftCorner(l, l));
            q.leftCols(l) = q_z;
            q.rightCols(rank_) -= q_z * factor.triangle.block(0, l, l, rank_);
        }
        if (rank_ > 0) {
            Eigen::MatrixXd q_theta = q.rightCols(rank_);
            models::divide_by_upper_in_place(q_theta, triangle_);
            q.rightCols(rank_) = q_theta;
        }
        const auto pieces = cluster[b].empty()
                                ? 0
                                : static_cast<std::size_t>(1 + *std::max_element(cluster[b].begin(), cluster[b].end()));
        std::vector<std::vector<Eigen::Index>> members(pieces);
        for (Eigen::Index i = 0; i < q.rows(); ++i)
            members[static_cast<std::size_t>(own_cluster[static_cast<std::size_t>(i)])].push_back(i);
        for (std::size_t c = 0; c < pieces; ++c) {
            Part part{b, Eigen::MatrixXd::Zero(l + rank_, l + rank_), {}};
            Eigen::VectorXd score = Eigen::VectorXd::Zero(l + rank_);
            for (const Eigen::Index i : members[c]) {
                part.gram.noalias() += q.row(i).transpose() * q.row(i);
                score += q.row(i).transpose() * whitened_rows(i, whitened_rows.cols() - 1);
            }
            const models::SymmetricEigen eigen = models::symmetric_eigen(part.gram);
            const Eigen::VectorXd root = eigen.values.unaryExpr(
                [](double value) { return 1.0 - value > alone ? 1.0 / std::sqrt(1.0 - value) : 0.0; });
            part.root = eigen.vectors * root.asDiagonal() * eigen.vectors.transpose();
            const Eigen::VectorXd own = (part.root * score).tail(rank_);
            meat.noalias() += own * own.transpose();
            parts_.push_back(std::move(part));
        }
    }
    Eigen::MatrixXd half = meat;
    models::solve_upper_in_place(triangle_, half);
    half = half.transpose().eval();
    models::solve_upper_in_place(triangle_, half);
    covariance_ = 0.5 * (half + half.transpose());
}

double Sandwich::degrees_of_freedom(const Eigen::VectorXd& direction) const {
    Eigen::VectorXd c = direction;
    models::solve_transposed_upper_in_place(triangle_, c);
    // With p_i = gram_i g_i the matrix has the entries g_i.p_i - p_i.p_i and -p_i.p_j; of clusters of different blocks
    // the parameters alone are shared. The sum of their squares over all pairs is that of a matrix sum p p^T.
    double trace = 0.0;
    double norm = 0.0;
    Eigen::MatrixXd all = Eigen::MatrixXd::Zero(rank_, rank_);
    for (std::size_t first = 0, last = 0; first < parts_.size(); first = last) {
        Eigen::MatrixXd sum = Eigen::MatrixXd::Zero(parts_[first].gram.rows(), parts_[first].gram.rows());
        for (last = first; last < parts_.size() && parts_[last].block == parts_[first].block; ++last) {
            const Part& part = parts_[last];
            Eigen::VectorXd padded = Eigen::VectorXd::Zero(part.gram.rows());
            padded.tail(rank_) = c;
            const Eigen::VectorXd g = part.root * padded;
            const Eigen::VectorXd p = part.gram * g;
            const double own = p.squaredNorm();
            const double entry = g.dot(p) - own;
            trace += entry;
            norm += entry * entry - own * own;
            sum.noalias() += p * p.transpose();
        }
        const auto shared = sum.bottomRightCorner(rank_, rank_);
        norm += sum.squaredNorm() - shared.squaredNorm();
        all += shared;
    }
    norm += all.squaredNorm();
    return norm > 0.0 ? std::max(1.0, trace * trace / norm) : 1.0;
}

}  // namespace orbid::estimator
