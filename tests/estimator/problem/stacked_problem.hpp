#pragma once

#include <cmath>
#include <cstdint>
#include <utility>
#include <vector>

#include <Eigen/Core>
#include <boost/multiprecision/cpp_bin_float.hpp>
#include <boost/multiprecision/eigen.hpp>

#include "estimator/algebra/block_arrow.hpp"

/// Small least-squares problems with latent states, and their solution as one dense matrix in quadruple precision.
namespace orbid::estimator::test {

using Quad = boost::multiprecision::number<boost::multiprecision::cpp_bin_float_quad::backend_type,
                                           boost::multiprecision::et_off>;
using QuadMatrix = Eigen::Matrix<Quad, Eigen::Dynamic, Eigen::Dynamic>;

struct StackedBlock {
    Eigen::Index latents = 0;
    Eigen::MatrixXd own;   ///< [A_z | A | w]
    Eigen::MatrixXd link;  ///< [C_z | C_next | C_theta | c]
    std::ptrdiff_t next = -1;
};

struct StackedProblem {
    Eigen::Index parameters = 0;
    std::vector<StackedBlock> block;

    [[nodiscard]] Eigen::Index offset(std::size_t b) const {
        Eigen::Index sum = 0;
        for (std::size_t i = 0; i < b; ++i)
            sum += block[i].latents;
        return sum;
    }
    [[nodiscard]] std::vector<BlockTriangle> blocks() const {
        std::vector<BlockTriangle> result;
        for (const StackedBlock& rows : block) {
            result.push_back(block_triangle(rows.own, rows.latents));
            result.back().link = rows.link;
            result.back().next = rows.next;
        }
        return result;
    }
};

/// Uniform numbers in (-1, 1), the same with every library: a linear congruential generator (Knuth's MMIX constants).
class Numbers {
public:
    explicit Numbers(std::uint64_t seed) : state_(seed) {
        for (int i = 0; i < 5; ++i)
            (*this)();
    }
    double operator()() {
        state_ = 6364136223846793005u * state_ + 1442695040888963407u;
        return static_cast<double>(state_ >> 11) / 4503599627370496.0 - 1.0;
    }
    Eigen::MatrixXd operator()(Eigen::Index rows, Eigen::Index columns) {
        Eigen::MatrixXd result(rows, columns);
        for (Eigen::Index j = 0; j < columns; ++j)
            for (Eigen::Index i = 0; i < rows; ++i)
                result(i, j) = (*this)();
        return result;
    }

private:
    std::uint64_t state_;
};

enum class Shape { independent, chain, cyclic };

/// Random rows; links z_next = Phi z + ... with Phi random of size two, weighted.
inline StackedProblem random_problem(int blocks, Eigen::Index l, Eigen::Index q, Shape shape, double weight,
                                     std::uint64_t seed) {
    Numbers random(seed);
    StackedProblem problem;
    problem.parameters = q;
    for (int b = 0; b < blocks; ++b) {
        StackedBlock block;
        block.latents = l;
        block.own = random(l + q + 1, l + q + 1);
        const bool last = b + 1 == blocks;
        if (shape == Shape::cyclic || (shape == Shape::chain && !last)) {
            block.next = last ? 0 : b + 1;
            block.link = random(l, 2 * l + q + 1);
            block.link.leftCols(l) *= 2.0;
            block.link.middleCols(l, l) = -Eigen::MatrixXd::Identity(l, l);
            block.link *= weight;
        }
        problem.block.push_back(block);
    }
    return problem;
}

struct Solution {
    Eigen::VectorXd unknowns;      ///< all latent states, then the parameters
    double log_determinant = 0.0;  ///< sum of ln|R_jj| over the latent columns
    QuadMatrix joint_covariance;
    QuadMatrix held_covariance;  ///< of the latent states with the parameters held

    using Groups = std::vector<std::pair<Eigen::Index, Eigen::Index>>;
    static Eigen::MatrixXd pick(const QuadMatrix& from, const Groups& groups) {
        std::vector<Eigen::Index> index;
        for (const auto& [start, length] : groups)
            for (Eigen::Index i = 0; i < length; ++i)
                index.push_back(start + i);
        return from(index, index).cast<double>();
    }
    [[nodiscard]] Eigen::MatrixXd joint(const Groups& groups) const { return pick(joint_covariance, groups); }
    [[nodiscard]] Eigen::MatrixXd held(const Groups& groups) const { return pick(held_covariance, groups); }
};

/// Upper triangle by plain Householder reflections; 34 digits leave fourteen at a weight of 1e10 in any order of rows.
inline QuadMatrix quad_triangle(QuadMatrix a) {
    const Eigen::Index columns = a.cols();
    for (Eigen::Index k = 0; k < std::min(columns, a.rows()); ++k) {
        const Eigen::Index rest = a.rows() - k;
        Quad square = 0;
        for (Eigen::Index i = k; i < a.rows(); ++i)
            square += a(i, k) * a(i, k);
        const Quad norm = a(k, k) < 0 ? Quad(-sqrt(square)) : Quad(sqrt(square));
        if (norm == 0) continue;
        std::vector<Quad> v(static_cast<std::size_t>(rest));
        for (Eigen::Index i = 0; i < rest; ++i)
            v[static_cast<std::size_t>(i)] = a(k + i, k);
        v[0] += norm;
        const Quad factor = 1 / (norm * v[0]);
        for (Eigen::Index j = k; j < columns; ++j) {
            Quad sum = 0;
            for (Eigen::Index i = 0; i < rest; ++i)
                sum += v[static_cast<std::size_t>(i)] * a(k + i, j);
            sum *= factor;
            for (Eigen::Index i = 0; i < rest; ++i)
                a(k + i, j) -= sum * v[static_cast<std::size_t>(i)];
        }
    }
    QuadMatrix r = QuadMatrix::Zero(columns, columns);
    for (Eigen::Index i = 0; i < std::min(columns, a.rows()); ++i)
        for (Eigen::Index j = i; j < columns; ++j)
            r(i, j) = a(i, j);
    return r;
}

/// R^-1 of the leading n columns.
inline QuadMatrix inverse_triangle(const QuadMatrix& r, Eigen::Index n) {
    QuadMatrix x = QuadMatrix::Zero(n, n);
    for (Eigen::Index j = 0; j < n; ++j) {
        for (Eigen::Index i = j; i >= 0; --i) {
            Quad sum = i == j ? 1 : 0;
            for (Eigen::Index k = i + 1; k <= j; ++k)
                sum -= r(i, k) * x(k, j);
            x(i, j) = sum / r(i, i);
        }
    }
    return x;
}

inline Solution dense_solution(const StackedProblem& problem, const BlockArrow& arrow, double mu) {
    const Eigen::Index q = problem.parameters;
    const Eigen::Index n = problem.offset(problem.block.size());
    Eigen::Index rows = mu > 0.0 ? n : 0;
    for (const StackedBlock& block : problem.block)
        rows += block.own.rows() + block.link.rows();
    Eigen::MatrixXd a = Eigen::MatrixXd::Zero(rows, n + q + 1);
    QuadMatrix damping = QuadMatrix::Zero(mu > 0.0 ? n : 0, n + q + 1);
    Eigen::Index row = 0;
    for (std::size_t b = 0; b < problem.block.size(); ++b) {
        const StackedBlock& block = problem.block[b];
        const Eigen::Index l = block.latents;
        const Eigen::Index at = problem.offset(b);
        a.block(row, at, block.own.rows(), l) = block.own.leftCols(l);
        a.block(row, n, block.own.rows(), q + 1) = block.own.rightCols(q + 1);
        row += block.own.rows();
        if (mu > 0.0)
            for (Eigen::Index j = 0; j < l; ++j)
                damping(at + j, at + j) = sqrt(Quad(mu)) * Quad(arrow.blocks[b].norm[j]);
        if (block.link.rows() == 0) continue;
        const Eigen::Index m = block.link.rows();
        a.block(row, at, m, l) += block.link.leftCols(l);
        if (block.next >= 0) {
            const auto next = static_cast<std::size_t>(block.next);
            const Eigen::Index l_next = problem.block[next].latents;
            a.block(row, problem.offset(next), m, l_next) += block.link.middleCols(l, l_next);
        }
        a.block(row, n, m, q + 1) = block.link.rightCols(q + 1);
        row += m;
    }
    QuadMatrix all = a.cast<Quad>();
    all.bottomRows(damping.rows()) = damping;
    const QuadMatrix r = quad_triangle(all);
    Solution solution;
    for (Eigen::Index j = 0; j < n; ++j)
        solution.log_determinant += static_cast<double>(Quad(log(Quad(abs(r(j, j))))));
    const QuadMatrix inverse = inverse_triangle(r, n + q);
    const QuadMatrix x = inverse * r.topRightCorner(n + q, 1);
    solution.unknowns = -x.cast<double>();
    solution.joint_covariance = inverse * inverse.transpose();
    const QuadMatrix held = inverse.topLeftCorner(n, n);
    solution.held_covariance = held * held.transpose();
    return solution;
}

}  // namespace orbid::estimator::test
