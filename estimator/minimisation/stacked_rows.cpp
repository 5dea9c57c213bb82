#include "estimator/minimisation/stacked_rows.hpp"

#include <algorithm>
#include <cmath>

#include <oneapi/tbb/parallel_for.h>
#include <boost/container/small_vector.hpp>

#include "estimator/algebra/r_factor.hpp"
#include "models/arithmetic/column_products.hpp"
#include "models/arithmetic/triangular_solve.hpp"

namespace orbid::estimator {

namespace {

/// Rows worked on together (twenty columns of them fit the second cache), and how many make other threads worth waking.
constexpr Eigen::Index piece_records = 1024;
constexpr Eigen::Index parallel_records = 10000;
/// Products of columns are used where each column keeps this fraction of its length beside the others. The R factor
/// then has eight digits, and steps shrink by that much each time; minimise() judges the rest.
constexpr double least_independence = 1e-4;

}  // namespace

StackedRows::StackedRows(const BlockSet& set) : set_(set) {
    for (std::size_t b = 0; b < set.blocks.size(); ++b) {
        const auto own = static_cast<Eigen::Index>(set.blocks[b].channel().size());
        for (Eigen::Index first = 0; first < own; first += piece_records)
            pieces_.push_back({b, first, std::min(piece_records, own - first), records_ + first});
        records_ += own;
    }
}

void StackedRows::set_errors(const Evaluation& evaluation, Eigen::VectorXd& e) const {
    e.resize(records_);
    Eigen::Index place = 0;
    for (std::size_t b = 0; b < set_.blocks.size(); ++b) {
        const Eigen::VectorXd& deviation = set_.blocks[b].deviation;
        const Eigen::VectorXd& own = evaluation.values[b].e;
        if (deviation.size() > 0)
            e.segment(place, own.size()) = own.cwiseQuotient(deviation);
        else
            e.segment(place, own.size()) = own;
        place += own.size();
    }
}

/// Calls use(columns): the columns of the piece's rows.
template <class Use>
void StackedRows::with_columns(const Evaluation& at, const Piece& piece, Use use) const {
    const auto rows = at.values[piece.block].e_theta.middleRows(piece.first, piece.count);
    const Eigen::VectorXd& deviation = set_.blocks[piece.block].deviation;
    Eigen::MatrixXd divided;
    if (deviation.size() > 0) divided = deviation.segment(piece.first, piece.count).cwiseInverse().asDiagonal() * rows;
    boost::container::small_vector<const double*, 16> columns;
    for (Eigen::Index j = 0; j < rows.cols(); ++j)
        columns.push_back(deviation.size() > 0 ? divided.col(j).data() : rows.col(j).data());
    use(columns);
}

/// Upper triangle of [E | e]^T [E | e]. Summed in the order of the pieces, whatever the threads.
Eigen::MatrixXd StackedRows::products(const Evaluation& at, const Eigen::VectorXd& e) const {
    const Eigen::Index q = at.values.front().e_theta.cols();
    Eigen::MatrixXd result = Eigen::MatrixXd::Zero(q + 1, q + 1);
    const auto add = [&](const Piece& piece, Eigen::MatrixXd& sum) {
        with_columns(at, piece, [&](auto& columns) {
            columns.push_back(e.data() + piece.place);
            models::add_column_products(columns.data(), columns.size(), static_cast<std::size_t>(piece.count),
                                        sum.data());
        });
    };
    if (records_ < parallel_records) {
        for (const Piece& piece : pieces_)
            add(piece, result);
        return result;
    }
    std::vector<Eigen::MatrixXd> sums(pieces_.size(), result);
    oneapi::tbb::parallel_for(std::size_t{0}, pieces_.size(), [&](std::size_t p) { add(pieces_[p], sums[p]); });
    for (const Eigen::MatrixXd& sum : sums)
        result += sum;
    return result;
}

/// The R factor by products of columns, at a fraction of the cost of reflections, where the columns are far enough from
/// dependence. Its relative error is the rounding divided by the square of the least diagonal.
/// @return whether they are
bool StackedRows::by_products(const Evaluation& at, const Eigen::VectorXd& slope, const Eigen::VectorXd& e,
                              Eigen::MatrixXd& triangle) const {
    const Eigen::MatrixXd sums = products(at, e);
    const Eigen::Index q = slope.size();
    const Eigen::VectorXd norm = sums.diagonal().head(q).cwiseSqrt();
    if (!(norm.minCoeff() > 0.0) || !norm.allFinite()) return false;
    triangle = Eigen::MatrixXd::Zero(q + 1, q + 1);
    for (Eigen::Index j = 0; j < q; ++j)
        for (Eigen::Index i = 0; i <= j; ++i) {
            const double rest = sums(i, j) / (norm[i] * norm[j]) - triangle.col(i).head(i).dot(triangle.col(j).head(i));
            if (i == j && !(rest > least_independence * least_independence)) return false;
            triangle(i, j) = i == j ? std::sqrt(rest) : rest / triangle(i, i);
        }
    Eigen::VectorXd rhs = sums.col(q).head(q).cwiseQuotient(norm);
    models::solve_transposed_upper_in_place(triangle.topLeftCorner(q, q), rhs);
    triangle.topLeftCorner(q, q) *= norm.cwiseProduct(slope).asDiagonal();
    triangle.col(q).head(q) = rhs;
    return true;
}

Eigen::VectorXd StackedRows::gathered(const Evaluation& at, const Eigen::VectorXd& along) const {
    Eigen::VectorXd result = Eigen::VectorXd::Zero(at.values.front().e_theta.cols());
    for (const Piece& piece : pieces_)
        with_columns(at, piece, [&](const auto& columns) {
            models::add_products_with(along.data() + piece.place, columns.data(), columns.size(),
                                      static_cast<std::size_t>(piece.count), result.data());
        });
    return result;
}

Eigen::MatrixXd StackedRows::triangle(const Evaluation& at, const Eigen::VectorXd& slope,
                                      const Eigen::VectorXd& e) const {
    Eigen::MatrixXd result;
    if (by_products(at, slope, e, result)) return result;
    const Eigen::Index q = slope.size();
    Eigen::MatrixXd rows(records_, q + 1);
    for (const Piece& piece : pieces_)
        with_columns(at, piece, [&](const auto& columns) {
            for (Eigen::Index j = 0; j < q; ++j)
                rows.col(j).segment(piece.place, piece.count) =
                    slope[j] * Eigen::VectorXd::Map(columns[static_cast<std::size_t>(j)], piece.count);
        });
    rows.col(q) = e;
    return upper_triangle(rows);
}

}  // namespace orbid::estimator
