#pragma once

#include <memory>

#include <Eigen/Core>

namespace orbid::models {

/// A = Q R by Householder reflections, in place: R in and above the diagonal of `a`, reflectors below it.
void householder_in_place(Eigen::Ref<Eigen::MatrixXd> a);

/// A = Q R of a matrix of shape (m, n) by Householder reflections, without pivoting.
class HouseholderFactor {
public:
    HouseholderFactor();  ///< of nothing, until compute()
    explicit HouseholderFactor(const Eigen::MatrixXd& a);
    HouseholderFactor(HouseholderFactor&&) = default;
    HouseholderFactor& operator=(HouseholderFactor&&) = default;

    /// Factorises another matrix in the memory already allocated.
    void compute(const Eigen::MatrixXd& a);

    /// R in and above the diagonal; reflectors below it. Shape (m, n).
    [[nodiscard]] const Eigen::MatrixXd& packed() const;
    [[nodiscard]] Eigen::MatrixXd q() const;  ///< shape (m, m)
    /// x becomes Q^T x, shape (m, any).
    void apply_transposed_q(Eigen::MatrixXd& x) const;
    /// R^-1 times the first n rows of Q^T b: least squares for m >= n and full rank.
    [[nodiscard]] Eigen::MatrixXd solve(const Eigen::MatrixXd& b) const;

private:
    struct Factor;
    std::shared_ptr<Factor> factor_;
};

/// A P = Q R of a matrix of shape (m, n) by Householder reflections; each pivot is the longest remaining column.
class PivotedFactor {
public:
    PivotedFactor();  ///< of nothing
    explicit PivotedFactor(const Eigen::MatrixXd& a);
    /// Pivots below `threshold` of the largest count as zero; without it rounding decides.
    PivotedFactor(const Eigen::MatrixXd& a, double threshold);

    [[nodiscard]] Eigen::Index rank() const;
    /// R in and above the diagonal; reflectors below it. Shape (m, n).
    [[nodiscard]] const Eigen::MatrixXd& packed() const;
    void apply_q(Eigen::MatrixXd& x) const;                                       ///< x becomes Q x
    void apply_transposed_q(Eigen::MatrixXd& x) const;                            ///< x becomes Q^T x
    [[nodiscard]] Eigen::MatrixXd permuted(const Eigen::MatrixXd& x) const;       ///< P x
    [[nodiscard]] Eigen::MatrixXd permuted_back(const Eigen::MatrixXd& x) const;  ///< P^T x
    /// A least-squares solution; components of vanishing pivots are zero.
    [[nodiscard]] Eigen::VectorXd solve(const Eigen::VectorXd& b) const;
    [[nodiscard]] Eigen::MatrixXd solve(const Eigen::MatrixXd& b) const;

private:
    struct Factor;
    std::shared_ptr<const Factor> factor_;
};

/// A P = Q [T 0; 0 0] Z of a matrix of any rank, shape (m, n): T is upper triangular of the rank's size.
class CompleteFactor {
public:
    CompleteFactor();  ///< of nothing, until compute()
    explicit CompleteFactor(const Eigen::MatrixXd& a);
    CompleteFactor(CompleteFactor&&) = default;
    CompleteFactor& operator=(CompleteFactor&&) = default;

    /// Pivots below `threshold` of the largest count as zero.
    void compute(const Eigen::Ref<const Eigen::MatrixXd>& a, double threshold);

    [[nodiscard]] Eigen::Index rank() const;
    /// The least-squares solution of smallest norm.
    [[nodiscard]] Eigen::VectorXd solve(const Eigen::VectorXd& b) const;
    [[nodiscard]] Eigen::MatrixXd solve(const Eigen::MatrixXd& b) const;
    [[nodiscard]] Eigen::MatrixXd pseudo_inverse() const;
    /// Z P^T g: the first `rank` components lie in the row space of A, the others in its null space.
    [[nodiscard]] Eigen::VectorXd row_space_coordinates(const Eigen::VectorXd& g) const;
    /// x becomes T^-T x, shape (rank).
    void solve_transposed_t_in_place(Eigen::VectorXd& x) const;

private:
    struct Factor;
    std::shared_ptr<Factor> factor_;
};

}  // namespace orbid::models
