#include "orbits/cycles/common_errors.hpp"

#include <algorithm>
#include <cmath>

namespace orbid::orbits {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

MatrixXd common_root(const VectorXd& sd, Index largest, const std::function<VectorXd(Index)>& covariance) {
    const Index records = sd.size();
    // A logarithm that was not measured shares nothing.
    const VectorXd scale = (sd.array() > 0.0 && sd.array().isFinite()).select(sd, 0.0);
    const VectorXd unit = (scale.array() > 0.0).select(scale.cwiseInverse(), 0.0);
    VectorXd left = (scale.array() > 0.0).cast<double>();  // of each record's shared variance
    MatrixXd root(records, 64);
    Index rank = 0, pivot = 0;
    while (rank < std::min(records, largest) && left.maxCoeff(&pivot) > shared_remainder) {
        if (rank == root.cols()) root.conservativeResize(records, 2 * rank);
        const VectorXd next = (unit.array() > 0.0).select(unit[pivot] * unit.cwiseProduct(covariance(pivot)), 0.0) -
                              root.leftCols(rank) * root.row(pivot).head(rank).transpose();
        root.col(rank) = next / std::sqrt(next[pivot]);
        left -= root.col(rank).cwiseAbs2();
        left[pivot] = 0.0;
        ++rank;
    }
    return scale.asDiagonal() * root.leftCols(rank);
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
        if (cycle.common.rows() == 0) continue;
        long_form.middleCols(first, cycle.common.rows()) = cycle.common.transpose();
        first += cycle.common.rows();
    }
    const VectorXd sd = long_form.colwise().norm().transpose();
    const MatrixXd root =
        common_root(sd, columns, [&](Index record) { return VectorXd(long_form.transpose() * long_form.col(record)); });
    first = 0;
    for (Cycle& cycle : cycles) {
        const Index own = cycle.common.rows();
        if (own == 0) continue;
        cycle.common = root.middleRows(first, own);
        first += own;
    }
}

}  // namespace orbid::orbits
