#include "models/arithmetic/triangular_solve.hpp"

namespace orbid::models {

using Eigen::MatrixXd;
using Eigen::Ref;
using Eigen::VectorXd;

void solve_upper_in_place(const Ref<const MatrixXd>& r, VectorXd& x) {
    r.triangularView<Eigen::Upper>().solveInPlace(x);
}

void solve_upper_in_place(const Ref<const MatrixXd>& r, MatrixXd& x) {
    r.triangularView<Eigen::Upper>().solveInPlace(x);
}

void solve_transposed_upper_in_place(const Ref<const MatrixXd>& r, VectorXd& x) {
    r.transpose().triangularView<Eigen::Lower>().solveInPlace(x);
}

void solve_transposed_upper_in_place(const Ref<const MatrixXd>& r, MatrixXd& x) {
    r.transpose().triangularView<Eigen::Lower>().solveInPlace(x);
}

void solve_lower_in_place(const Ref<const MatrixXd>& l, VectorXd& x) {
    l.triangularView<Eigen::Lower>().solveInPlace(x);
}

void solve_lower_in_place(const Ref<const MatrixXd>& l, MatrixXd& x) {
    l.triangularView<Eigen::Lower>().solveInPlace(x);
}

void divide_by_upper_in_place(MatrixXd& x, const Ref<const MatrixXd>& r) {
    r.triangularView<Eigen::Upper>().solveInPlace<Eigen::OnTheRight>(x);
}

}  // namespace orbid::models
