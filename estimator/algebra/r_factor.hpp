#pragma once

#include <Eigen/Core>

namespace orbid::estimator {

/// Upper trapezoid R of a = Q R, shape (columns, columns), padded with zero rows.
///
/// Tall stacks are divided into panels that fit the cache; the panels' R factors are stacked and factorised again. This
/// tree depends on the shape alone: same bytes with any number of threads. If the sizes of a panel's rows differ by
/// more than a thousand, they are sorted, heavy ones first: Householder reflections are then row-wise stable. Source:
/// Demmel, Grigori, Hoemmen, Langou, SIAM J. Sci. Comput. 34 (2012) A206 (tall-skinny QR); Cox and Higham, "Stability
/// of Householder QR factorization for weighted least squares problems" (1998) (row sorting).
[[nodiscard]] Eigen::MatrixXd upper_triangle(const Eigen::Ref<const Eigen::MatrixXd>& a);

/// A stack of rows that is kept short by its R factor.
class ShortRows {
public:
    explicit ShortRows(Eigen::Index width) : rows_(12 * width, width) {}
    void add(const Eigen::Ref<const Eigen::MatrixXd>& rows) {
        if (count_ + rows.rows() > rows_.rows()) {
            const Eigen::MatrixXd short_rows = triangle();
            if (short_rows.rows() + rows.rows() > rows_.rows())
                rows_.resize(2 * (short_rows.rows() + rows.rows()), short_rows.cols());
            rows_.topRows(short_rows.rows()) = short_rows;
            count_ = short_rows.rows();
        }
        rows_.middleRows(count_, rows.rows()) = rows;
        count_ += rows.rows();
    }
    [[nodiscard]] Eigen::MatrixXd triangle() const { return upper_triangle(rows_.topRows(count_)); }

private:
    Eigen::MatrixXd rows_;
    Eigen::Index count_ = 0;
};

/// Replaces an upper triangle [R | rhs], shape (columns, columns + 1), by the R factor of itself on top of
/// [diag(diagonal) | 0], by rotations.
void add_diagonal(Eigen::MatrixXd& triangle, const Eigen::VectorXd& diagonal);

/// Householder elimination of the columns [first, first + count) from the rows [top, a.rows()), in place; all columns
/// from `first` on are transformed. Rows top ... top + rank - 1 then hold the pivots in pivot order (the columns keep
/// their places: R(k, order[k]) is the k-th diagonal), and those columns are zero below.
///
/// The pivot column is the one with the largest remaining norm, the pivot row the one with the largest entry in it
/// (Powell and Reid 1969). Light rows are thus not lost beside rows that weigh 1e10 times as much or more. A column
/// whose remaining norm is not above limit[j], or so small that its square leaves the range of a double, is set to zero
/// in the remaining rows and is no pivot.
/// @param limit  shape (count).
/// @param order  shape (count), written: order[k] = the column (counted from `first`) that became the k-th pivot; the
///               columns order[rank], order[rank + 1] ... are undetermined.
/// @return the rank.
Eigen::Index eliminate(Eigen::Ref<Eigen::MatrixXd> a, Eigen::Index top, Eigen::Index first, const double* limit,
                       Eigen::Index count, Eigen::Index* order);

}  // namespace orbid::estimator
