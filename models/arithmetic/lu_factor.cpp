#include "models/arithmetic/lu_factor.hpp"

#include <Eigen/LU>

namespace orbid::models {

using Eigen::MatrixXd;
using Eigen::VectorXd;

struct LuFactor::Factor {
    Eigen::PartialPivLU<MatrixXd> lu;
};

LuFactor::LuFactor(const MatrixXd& a) : factor_(new Factor{Eigen::PartialPivLU<MatrixXd>(a)}) {}

VectorXd LuFactor::solve(const VectorXd& b) const {
    return factor_->lu.solve(b);
}

MatrixXd LuFactor::solve(const MatrixXd& b) const {
    return factor_->lu.solve(b);
}

MatrixXd LuFactor::inverse() const {
    return factor_->lu.inverse();
}

MatrixXd inverse(const MatrixXd& a) {
    return a.inverse();
}

MatrixUpTo4 inverse(const MatrixUpTo4& a) {
    return a.inverse();
}

}  // namespace orbid::models
