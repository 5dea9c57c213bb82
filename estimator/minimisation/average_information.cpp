#include "estimator/minimisation/average_information.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "estimator/algebra/block_loop.hpp"
#include "estimator/minimisation/row_coordinate.hpp"

namespace orbid::estimator {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// Rows [A | w] as [A | w of each scale | w], with w where the step leads.
/// @param moved  the step of all columns of A; empty: none.
MatrixXd with_scale_columns(const ErrorProblem& problem, const BlockRows& block, const std::vector<PartRows>& parts,
                            const Eigen::Ref<const MatrixXd>& at, const VectorXd& moved,
                            const std::vector<Index>& free) {
    const Index columns = at.cols() - 1, scales = std::ssize(free);
    MatrixXd result(at.rows(), columns + scales + 1);
    result.leftCols(columns) = at.leftCols(columns);
    result.middleCols(columns, scales).setZero();
    auto w = result.col(columns + scales);
    w = at.col(columns);
    for (Index j = 0; j < moved.size(); ++j)
        for (Index i = 0; i < w.size(); ++i)
            w[i] += at(i, j) * moved[j];
    for_coordinates(*problem.laws, problem.free, block, parts, [&](const RowCoordinate& coordinate) {
        const auto scale = std::find(free.begin(), free.end(), coordinate.k) - free.begin();
        if (scale == scales) return;  // held at a limit
        result.col(columns + scale).segment(coordinate.first, coordinate.rows) =
            w.segment(coordinate.first, coordinate.rows);
    });
    return result;
}

/// The law whose scale this error parameter is; null: it is none.
const NoiseModel* law_of_scale(const ErrorProblem& problem, const VectorXd& psi, Index k) {
    for (const NoiseModel& law : *problem.laws)
        if (law.first == k && law.scale_information(law.own(psi)) > 0.0) return &law;
    return nullptr;
}

/// Lengths that the columns of the scales are to have over those that they have.
VectorXd stretches(const ErrorProblem& problem, const VectorXd& psi, const std::vector<BlockTriangle>& blocks,
                   const std::vector<Index>& free) {
    const Index scales = std::ssize(free);
    VectorXd square = VectorXd::Zero(scales);
    for (const BlockTriangle& block : blocks)
        for (const MatrixXd* rows : {&block.triangle, &block.link})
            if (rows->size() > 0)
                square += rows->middleCols(rows->cols() - scales - 1, scales).colwise().squaredNorm().transpose();
    problem.set->spread.sum(square);
    VectorXd result = VectorXd::Ones(scales);
    for (Index i = 0; i < scales; ++i) {
        const NoiseModel& law = *law_of_scale(problem, psi, free[static_cast<std::size_t>(i)]);
        if (law.compressible() || !(square[i] > 0.0)) continue;
        const double information = problem.set->count[law.channels.front()] * law.scale_information(law.own(psi));
        result[i] = std::sqrt(0.5 * information / square[i]);
    }
    return result;
}

}  // namespace

bool has_average_information(const ErrorProblem& problem, const VectorXd& psi, const std::vector<Index>& free) {
    const bool shaped = std::any_of(problem.rows->begin(), problem.rows->end(),
                                    [](const BlockRows& block) { return block.rows.size() > 0; });
    return !shaped &&
           std::all_of(free.begin(), free.end(), [&](Index k) { return law_of_scale(problem, psi, k) != nullptr; });
}

MatrixXd average_information(const ErrorProblem& problem, const VectorXd& psi, WhitenedArrow standard,
                             const ErrorStep& step, const std::vector<Index>& free) {
    const Index parameters = problem.basis.rows(), scales = std::ssize(free);
    const bool moving = !step.d_z.empty();
    standard.arrow.undamped.clear();
    std::vector<BlockTriangle> blocks(problem.rows->size());
    for_blocks(blocks.size(), [&](std::size_t b) {
        const BlockRows& block = (*problem.rows)[b];
        VectorXd moved;
        if (moving) {
            moved.resize(step.d_z[b].size() + step.u.size());
            moved << step.d_z[b], step.u;
        }
        MatrixXd rows = with_scale_columns(problem, block, block.parts, standard.own_rows(b), moved, free);
        blocks[b] = standard.arrow.linked[b] ? linked_block(std::move(rows), block.latents)
                                             : block_triangle(rows, block.latents);
        MatrixXd& link = standard.arrow.blocks[b].link;
        blocks[b].next = standard.arrow.blocks[b].next;
        if (link.rows() == 0) return;
        // Constraints come first and belong to no scale.
        const Index constraints = link.rows() - standard.linked_records[b];
        blocks[b].link.resize(link.rows(), link.cols() + scales);
        if (constraints > 0)
            blocks[b].link.topRows(constraints) << link.topLeftCorner(constraints, link.cols() - 1),
                MatrixXd::Zero(constraints, scales), link.topRightCorner(constraints, 1);
        if (moving && block.next >= 0) {
            const VectorXd& next = step.d_z[static_cast<std::size_t>(block.next)];
            moved.resize(step.d_z[b].size() + next.size() + step.u.size());
            moved << step.d_z[b], next, step.u;
        }
        blocks[b].link.bottomRows(standard.linked_records[b]) =
            with_scale_columns(problem, block, block.linked_parts, standard.linked_rows(b), moved, free);
        link = {};
    });
    const VectorXd stretch = stretches(problem, psi, blocks, free);
    const Spread spread = standard.arrow.spread;
    standard = {};
    const ReducedProblem reduced = condense(factorise(std::move(blocks), parameters + scales, spread), 0.0);
    MatrixXd of_scales = reduced.r.rightCols(scales);
    if (problem.restricted) {
        const Index rank = problem.basis.cols(), prior = problem.prior_rows.rows();
        MatrixXd stacked(reduced.r.rows() + prior, rank + scales);
        stacked << reduced.r.leftCols(parameters) * problem.basis, of_scales, problem.prior_rows,
            MatrixXd::Zero(prior, scales);
        of_scales = upper_triangle(std::move(stacked)).bottomRightCorner(scales, scales);
    }
    of_scales *= stretch.asDiagonal();
    return 2.0 * of_scales.transpose() * of_scales;
}

}  // namespace orbid::estimator
