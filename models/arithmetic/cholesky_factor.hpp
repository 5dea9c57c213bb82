#pragma once

#include <memory>

#include <Eigen/Core>

namespace orbid::models {

/// A = L L^T of a symmetric, positive definite matrix, shape (n, n); its lower triangle is read.
class CholeskyFactor {
public:
    explicit CholeskyFactor(const Eigen::MatrixXd& a);

    /// false where a pivot was not positive; everything else is then meaningless. Numbers that are not finite may pass.
    [[nodiscard]] bool positive_definite() const { return positive_definite_; }
    [[nodiscard]] const Eigen::MatrixXd& lower() const { return lower_; }  ///< L, zeros above the diagonal

    /// y becomes y + L x.
    void add_lower_times(const Eigen::VectorXd& x, Eigen::VectorXd& y) const;
    /// A^-1 b.
    [[nodiscard]] Eigen::MatrixXd solve(const Eigen::MatrixXd& b) const;
    /// b becomes L^-1 b.
    void solve_lower_in_place(Eigen::VectorXd& b) const;
    void solve_lower_in_place(Eigen::MatrixXd& b) const;

private:
    Eigen::MatrixXd lower_;
    bool positive_definite_;
};

/// P A P^T = L D L^T of a symmetric matrix, shape (n, n), with pivoting; its lower triangle is read.
class LdltFactor {
public:
    explicit LdltFactor(const Eigen::MatrixXd& a);

    /// false where a pivot vanished before the last ones: the factors are then meaningless.
    [[nodiscard]] bool succeeded() const;
    [[nodiscard]] bool positive_semidefinite() const;  ///< no negative pivot
    /// Diagonal of D, valid as long as the factor.
    [[nodiscard]] Eigen::Diagonal<const Eigen::MatrixXd> pivots() const;
    /// P^T L sqrt(max(D, 0)): times its transpose it is A, where A is positive semidefinite.
    [[nodiscard]] Eigen::MatrixXd root() const;

    [[nodiscard]] Eigen::MatrixXd inverse() const;
    /// A^-1 b; 0 along directions of vanishing pivots.
    [[nodiscard]] Eigen::VectorXd solve(const Eigen::VectorXd& b) const;
    [[nodiscard]] Eigen::MatrixXd solve(const Eigen::MatrixXd& b) const;

private:
    struct Factor;
    std::shared_ptr<const Factor> factor_;
};

}  // namespace orbid::models
