#include "models/arithmetic/orthogonal_factor.hpp"

#include <utility>

#include <Eigen/QR>

namespace orbid::models {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::Ref;
using Eigen::VectorXd;

void householder_in_place(Ref<MatrixXd> a) {
    const Eigen::HouseholderQR<Ref<MatrixXd>> qr(a);
}

struct HouseholderFactor::Factor {
    Eigen::HouseholderQR<MatrixXd> qr;
};

HouseholderFactor::HouseholderFactor() : factor_(new Factor) {}
HouseholderFactor::HouseholderFactor(const MatrixXd& a) : factor_(new Factor{Eigen::HouseholderQR<MatrixXd>(a)}) {}

void HouseholderFactor::compute(const MatrixXd& a) {
    factor_->qr.compute(a);
}

const MatrixXd& HouseholderFactor::packed() const {
    return factor_->qr.matrixQR();
}

MatrixXd HouseholderFactor::q() const {
    return factor_->qr.householderQ();
}

void HouseholderFactor::apply_transposed_q(MatrixXd& x) const {
    x.applyOnTheLeft(factor_->qr.householderQ().adjoint());
}

MatrixXd HouseholderFactor::solve(const MatrixXd& b) const {
    return factor_->qr.solve(b);
}

struct PivotedFactor::Factor {
    Eigen::ColPivHouseholderQR<MatrixXd> qr;
};

PivotedFactor::PivotedFactor() : factor_(new Factor) {}
PivotedFactor::PivotedFactor(const MatrixXd& a) : factor_(new Factor{Eigen::ColPivHouseholderQR<MatrixXd>(a)}) {}
PivotedFactor::PivotedFactor(const MatrixXd& a, double threshold) {
    auto factor = std::make_shared<Factor>(Factor{Eigen::ColPivHouseholderQR<MatrixXd>(a)});
    factor->qr.setThreshold(threshold);
    factor_ = std::move(factor);
}

Index PivotedFactor::rank() const {
    return factor_->qr.rank();
}

const MatrixXd& PivotedFactor::packed() const {
    return factor_->qr.matrixQR();
}

void PivotedFactor::apply_q(MatrixXd& x) const {
    x.applyOnTheLeft(factor_->qr.householderQ());
}

void PivotedFactor::apply_transposed_q(MatrixXd& x) const {
    x.applyOnTheLeft(factor_->qr.householderQ().adjoint());
}

MatrixXd PivotedFactor::permuted(const MatrixXd& x) const {
    return factor_->qr.colsPermutation() * x;
}

MatrixXd PivotedFactor::permuted_back(const MatrixXd& x) const {
    return factor_->qr.colsPermutation().transpose() * x;
}

VectorXd PivotedFactor::solve(const VectorXd& b) const {
    return factor_->qr.solve(b);
}

MatrixXd PivotedFactor::solve(const MatrixXd& b) const {
    return factor_->qr.solve(b);
}

struct CompleteFactor::Factor {
    Eigen::CompleteOrthogonalDecomposition<MatrixXd> cod;
};

CompleteFactor::CompleteFactor() : factor_(new Factor) {}
CompleteFactor::CompleteFactor(const MatrixXd& a)
    : factor_(new Factor{Eigen::CompleteOrthogonalDecomposition<MatrixXd>(a)}) {}

void CompleteFactor::compute(const Ref<const MatrixXd>& a, double threshold) {
    factor_->cod.setThreshold(threshold);
    factor_->cod.compute(a);
}

Index CompleteFactor::rank() const {
    return factor_->cod.rank();
}

VectorXd CompleteFactor::solve(const VectorXd& b) const {
    return factor_->cod.solve(b);
}

MatrixXd CompleteFactor::solve(const MatrixXd& b) const {
    return factor_->cod.solve(b);
}

MatrixXd CompleteFactor::pseudo_inverse() const {
    return factor_->cod.pseudoInverse();
}

VectorXd CompleteFactor::row_space_coordinates(const VectorXd& g) const {
    // Of full rank Z = 1, but matrixZ() then reads coefficients that were never set.
    VectorXd permuted = factor_->cod.colsPermutation().transpose() * g;
    if (rank() == factor_->cod.cols()) return permuted;
    return factor_->cod.matrixZ() * permuted;
}

void CompleteFactor::solve_transposed_t_in_place(VectorXd& x) const {
    const Index r = rank();
    factor_->cod.matrixT().topLeftCorner(r, r).triangularView<Eigen::Upper>().transpose().solveInPlace(x);
}

}  // namespace orbid::models
