#include "orbits/series_residuals/chain_information.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "models/arithmetic/orthogonal_factor.hpp"
#include "models/arithmetic/triangular_solve.hpp"

namespace orbid::orbits {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

/// What an eliminated block leaves: R z + S z_next = -r.
struct Eliminated {
    MatrixXd triangle;  ///< R
    MatrixXd after;     ///< S
    VectorXd right;     ///< r
};

}  // namespace

ChainInformation chain_information(const std::vector<estimator::BlockLayout>& layout,
                                   const std::vector<estimator::BlockValue>& values, const VectorXd& scales) {
    ChainInformation result;
    result.step.resize(layout.size());
    std::vector<Eliminated> left(layout.size());
    MatrixXd before;  // rows on the states of this block and their right sides, from those before it
    for (std::size_t b = 0; b < layout.size(); ++b) {
        const estimator::BlockLayout& block = layout[b];
        const estimator::BlockValue& value = values[b];
        if (!block.active || value.status != estimator::BlockStatus::ok) {
            before.resize(0, 0);
            continue;
        }
        const Index n = block.latents;
        const bool linked = block.next == static_cast<std::ptrdiff_t>(b) + 1 && layout[b + 1].active;
        const Index own = block.linked_from >= 0 && !linked ? block.linked_from : value.e.size();
        const Index next = linked ? layout[b + 1].latents : 0;
        MatrixXd rows = MatrixXd::Zero(before.rows() + own, n + next + 1);
        if (before.rows() > 0) {
            rows.topLeftCorner(before.rows(), n) = before.leftCols(n);
            rows.topRightCorner(before.rows(), 1) = before.rightCols(1);
        }
        for (Index i = 0; i < own; ++i) {
            const double sd = scales[block.group[static_cast<std::size_t>(i)]] *
                              (block.deviation.size() > 0 ? block.deviation[i] : 1.0);
            auto row = rows.row(before.rows() + i);
            row.head(n) = value.e_z.row(i) / sd;
            if (linked && value.e_next.size() > 0) row.segment(n, next) = value.e_next.row(i) / sd;
            row[n + next] = value.e[i] / sd;
        }
        const Index kept = std::min<Index>(rows.rows(), rows.cols());
        models::householder_in_place(rows);
        const MatrixXd triangle = rows.topRows(kept).triangularView<Eigen::Upper>();
        left[b] = {triangle.topLeftCorner(n, n), triangle.block(0, n, n, next), triangle.col(n + next).head(n)};
        result.half_ln_determinant += left[b].triangle.diagonal().array().abs().log().sum();
        const Index rest = std::min<Index>(next, kept - n);
        before.resize(rest, next + 1);
        for (Index i = 0; i < rest; ++i)
            before.row(i) = triangle.row(n + i).tail(next + 1);
    }
    for (std::size_t b = layout.size(); b-- > 0;) {
        if (left[b].triangle.size() == 0) continue;
        VectorXd right = -left[b].right;
        if (left[b].after.cols() > 0) right -= left[b].after * result.step[b + 1];
        models::solve_upper_in_place(left[b].triangle, right);
        result.step[b] = std::move(right);
    }
    return result;
}

}  // namespace orbid::orbits
