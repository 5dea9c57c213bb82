#include "periodic/solution/closing_equations.hpp"

#include <cstddef>
#include <vector>

#include <Eigen/SparseCholesky>

namespace orbid::periodic {

using Eigen::SparseMatrix;

namespace {

SparseMatrix<double> scaled_jacobian(const ClosingError& closing, const VectorXd& scale) {
    const Index d = closing.error.rows(), count = closing.error.cols();
    std::vector<Eigen::Triplet<double>> entries;
    entries.reserve(static_cast<std::size_t>(count * d * (d + 2)));
    for (Index j = 0; j < count; ++j) {
        const MatrixXd& x = closing.jacobians[static_cast<std::size_t>(j)];
        for (Index row = 0; row < d; ++row) {
            for (Index column = 0; column < d; ++column)
                entries.emplace_back(d * j + row, d * j + column, x(row, column) * scale(column) / scale(row));
            entries.emplace_back(d * j + row, d * ((j + 1) % count) + row, -1.0);
            if (closing.by_ln_time.cols() > 0)
                entries.emplace_back(d * j + row, d * count, closing.by_ln_time(d * j + row, 0) / scale(row));
        }
    }
    SparseMatrix<double> jacobian(d * count, d * count + closing.by_ln_time.cols());
    jacobian.setFromTriplets(entries.begin(), entries.end());
    return jacobian;
}

}  // namespace

struct ClosingEquations::Factor {
    double weight = 1.0;
    SparseMatrix<double> jacobian;
    Eigen::SimplicialLDLT<SparseMatrix<double>> ldlt;
};

ClosingEquations::ClosingEquations(const ClosingError& closing, const VectorXd& scale, double weight,
                                   const VectorXd& own_weights)
    : factor_(std::make_unique<Factor>()) {
    factor_->weight = weight;
    factor_->jacobian = scaled_jacobian(closing, scale);
    const SparseMatrix<double>& jacobian = factor_->jacobian;
    SparseMatrix<double> normal = weight * SparseMatrix<double>(jacobian.transpose() * jacobian);
    normal.diagonal() += own_weights.size() > 0 ? own_weights : VectorXd(VectorXd::Ones(normal.rows()));
    factor_->ldlt.compute(normal);
}

ClosingEquations::~ClosingEquations() = default;

bool ClosingEquations::regular() const {
    return factor_->ldlt.info() == Eigen::Success;
}

VectorXd ClosingEquations::pulled(const VectorXd& r) const {
    return factor_->jacobian.transpose() * r;
}

MatrixXd ClosingEquations::pulled(const MatrixXd& r) const {
    return factor_->jacobian.transpose() * r;
}

VectorXd ClosingEquations::weighted_pull(const VectorXd& r) const {
    return factor_->weight * (factor_->jacobian.transpose() * r);
}

VectorXd ClosingEquations::solve(const VectorXd& b) const {
    return factor_->ldlt.solve(b);
}

MatrixXd ClosingEquations::solve(const MatrixXd& b) const {
    return factor_->ldlt.solve(b);
}

}  // namespace orbid::periodic
