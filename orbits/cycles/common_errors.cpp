#include "orbits/cycles/common_errors.hpp"

#include <algorithm>
#include <cmath>

namespace orbid::orbits {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

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
    VectorXd sd = long_form.colwise().norm().transpose();
    for (Index i = 0; i < records; ++i) {
        if (sd[i] > 0.0 && std::isfinite(sd[i])) {
            long_form.col(i) /= sd[i];
        } else {
            long_form.col(i).setZero();  // a logarithm that was not measured
            sd[i] = 0.0;
        }
    }
    VectorXd left = (sd.array() > 0.0).cast<double>();  // of each record's shared variance
    MatrixXd root(records, 64);
    Index rank = 0, pivot = 0;
    while (rank < std::min(records, columns) && left.maxCoeff(&pivot) > shared_remainder) {
        if (rank == root.cols()) root.conservativeResize(records, 2 * rank);
        const VectorXd next =
            long_form.transpose() * long_form.col(pivot) - root.leftCols(rank) * root.row(pivot).head(rank).transpose();
        root.col(rank) = next / std::sqrt(next[pivot]);
        left -= root.col(rank).cwiseAbs2();
        left[pivot] = 0.0;
        ++rank;
    }
    first = 0;
    for (Cycle& cycle : cycles) {
        const Index own = cycle.common.rows();
        if (own == 0) continue;
        cycle.common = sd.segment(first, own).asDiagonal() * root.block(first, 0, own, rank);
        first += own;
    }
}

}  // namespace orbid::orbits
