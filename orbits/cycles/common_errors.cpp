#include "orbits/cycles/common_errors.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace orbid::orbits {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

void cleared(MatrixXd& matrix, Index column) {
    matrix.col(column).setZero();
}

void cleared(Eigen::SparseMatrix<double>& matrix, Index column) {
    for (Eigen::SparseMatrix<double>::InnerIterator entry(matrix, column); entry; ++entry)
        entry.valueRef() = 0.0;
}

// @param long_form  one record per column
template <class Matrix>
MatrixXd shortened(Matrix long_form) {
    const Index records = long_form.cols(), columns = long_form.rows();
    VectorXd sd(records);
    for (Index i = 0; i < records; ++i) {
        sd[i] = long_form.col(i).norm();
        if (sd[i] > 0.0 && std::isfinite(sd[i])) {
            long_form.col(i) /= sd[i];
        } else {
            cleared(long_form, i);  // a logarithm that was not measured
            sd[i] = 0.0;
        }
    }
    VectorXd left = (sd.array() > 0.0).template cast<double>();  // of each record's shared variance
    MatrixXd root(records, 64);
    Index rank = 0, pivot = 0;
    while (rank < std::min(records, columns) && left.maxCoeff(&pivot) > shared_remainder) {
        if (rank == root.cols()) root.conservativeResize(records, 2 * rank);
        const VectorXd own = long_form.col(pivot);
        const VectorXd next =
            long_form.transpose() * own - root.leftCols(rank) * root.row(pivot).head(rank).transpose();
        root.col(rank) = next / std::sqrt(next[pivot]);
        left -= root.col(rank).cwiseAbs2();
        left[pivot] = 0.0;
        ++rank;
    }
    return sd.asDiagonal() * root.leftCols(rank);
}

}  // namespace

MatrixXd common_root(const Eigen::SparseMatrix<double>& long_form) {
    return shortened(long_form);
}

void shorten_common_errors(std::vector<Cycle>& cycles) {
    Index records = 0, columns = 0;
    for (const Cycle& cycle : cycles) {
        records += cycle.common.rows();
        columns = std::max(columns, cycle.common.cols());
    }
    if (records == 0) return;
    // One record per column: a column is then contiguous.
    MatrixXd long_form(columns, records);
    Index first = 0;
    for (const Cycle& cycle : cycles) {
        long_form.middleCols(first, cycle.common.rows()) = cycle.common.transpose();
        first += cycle.common.rows();
    }
    const MatrixXd root = shortened(std::move(long_form));
    first = 0;
    for (Cycle& cycle : cycles) {
        const Index own = cycle.common.rows();
        if (own == 0) continue;
        cycle.common = root.middleRows(first, own);
        first += own;
    }
}

}  // namespace orbid::orbits
