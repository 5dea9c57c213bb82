#include "models/arithmetic/cholesky_factor.hpp"

#include <Eigen/Cholesky>

#include "models/arithmetic/triangular_solve.hpp"

namespace orbid::models {

using Eigen::MatrixXd;
using Eigen::VectorXd;

CholeskyFactor::CholeskyFactor(const MatrixXd& a) {
    const Eigen::LLT<MatrixXd> factor(a);
    lower_ = factor.matrixL();
    positive_definite_ = factor.info() == Eigen::Success;
}

void CholeskyFactor::add_lower_times(const VectorXd& x, VectorXd& y) const {
    y.noalias() += lower_.triangularView<Eigen::Lower>() * x;
}

MatrixXd CholeskyFactor::solve(const MatrixXd& b) const {
    MatrixXd x = b;
    models::solve_lower_in_place(lower_, x);
    lower_.adjoint().triangularView<Eigen::Upper>().solveInPlace(x);
    return x;
}

void CholeskyFactor::solve_lower_in_place(VectorXd& b) const {
    models::solve_lower_in_place(lower_, b);
}

void CholeskyFactor::solve_lower_in_place(MatrixXd& b) const {
    models::solve_lower_in_place(lower_, b);
}

struct LdltFactor::Factor {
    Eigen::LDLT<MatrixXd> ldlt;
};

LdltFactor::LdltFactor(const MatrixXd& a) : factor_(new Factor{Eigen::LDLT<MatrixXd>(a)}) {}

bool LdltFactor::succeeded() const {
    return factor_->ldlt.info() == Eigen::Success;
}

bool LdltFactor::positive_semidefinite() const {
    return factor_->ldlt.isPositive();
}

Eigen::Diagonal<const MatrixXd> LdltFactor::pivots() const {
    return factor_->ldlt.vectorD();
}

MatrixXd LdltFactor::root() const {
    const Eigen::LDLT<MatrixXd>& ldlt = factor_->ldlt;
    return ldlt.transpositionsP().transpose() *
           MatrixXd(MatrixXd(ldlt.matrixL()) * ldlt.vectorD().cwiseMax(0.0).cwiseSqrt().asDiagonal());
}

MatrixXd LdltFactor::inverse() const {
    return factor_->ldlt.solve(MatrixXd::Identity(factor_->ldlt.rows(), factor_->ldlt.cols()));
}

VectorXd LdltFactor::solve(const VectorXd& b) const {
    return factor_->ldlt.solve(b);
}

MatrixXd LdltFactor::solve(const MatrixXd& b) const {
    return factor_->ldlt.solve(b);
}

}  // namespace orbid::models
