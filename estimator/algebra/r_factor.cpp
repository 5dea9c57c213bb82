#include "estimator/algebra/r_factor.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>

#include <oneapi/tbb/parallel_for.h>

#include "models/arithmetic/orthogonal_factor.hpp"

namespace orbid::estimator {

namespace {

/// Row sizes that differ by less do not need sorting: they lose at most three digits of the lightest row. Unsorted
/// problems of one scale are common and time-critical.
constexpr double mixed_weights = 1e3;

/// Entries up to which a panel is reflected by plain loops: there a call for blocks costs more than the sums.
constexpr Eigen::Index small_panel = 256;

/// Heavy rows first, where the rows differ enough for it to matter.
void sort_rows(Eigen::MatrixXd& a) {
    Eigen::VectorXd size = Eigen::VectorXd::Zero(a.rows());
    for (Eigen::Index j = 0; j < a.cols(); ++j)  // column by column: the matrix lies so in memory
        size = size.cwiseMax(a.col(j).cwiseAbs());
    double largest = 0.0;
    double smallest = std::numeric_limits<double>::infinity();
    for (Eigen::Index i = 0; i < size.size(); ++i) {
        if (!(size[i] > 0.0)) continue;
        largest = std::max(largest, size[i]);
        smallest = std::min(smallest, size[i]);
    }
    if (!(largest > mixed_weights * smallest)) return;
    std::vector<Eigen::Index> order(static_cast<std::size_t>(a.rows()));
    std::iota(order.begin(), order.end(), Eigen::Index{0});
    std::stable_sort(order.begin(), order.end(), [&size](Eigen::Index i, Eigen::Index j) { return size[i] > size[j]; });
    Eigen::MatrixXd sorted(a.rows(), a.cols());
    for (Eigen::Index i = 0; i < a.rows(); ++i)
        sorted.row(i) = a.row(order[static_cast<std::size_t>(i)]);
    a = std::move(sorted);
}

/// Two sums side by side: each waits for its own last addition only.
double dot(const double* a, const double* b, Eigen::Index count) {
    double even = 0.0;
    double odd = 0.0;
    Eigen::Index k = 0;
    for (; k + 1 < count; k += 2) {
        even += a[k] * b[k];
        odd += a[k + 1] * b[k + 1];
    }
    if (k < count) even += a[k] * b[k];
    return even + odd;
}

/// Householder reflections of a small matrix by plain loops. What is below the diagonal is left as it comes.
void reflect_small(Eigen::MatrixXd& a) {
    for (Eigen::Index k = 0; k < std::min(a.rows() - 1, a.cols()); ++k) {
        const Eigen::Index below = a.rows() - k - 1;
        double* const pivot = &a(k, k);
        const double square = dot(pivot + 1, pivot + 1, below);
        if (!(square > std::numeric_limits<double>::min()) && !std::isnan(square)) continue;
        const double diagonal = -std::copysign(std::sqrt(pivot[0] * pivot[0] + square), pivot[0]);
        const double share = (diagonal - pivot[0]) / diagonal;
        const double scale = 1.0 / (pivot[0] - diagonal);
        for (Eigen::Index i = 1; i <= below; ++i)
            pivot[i] *= scale;
        for (Eigen::Index j = k + 1; j < a.cols(); ++j) {
            double* const column = &a(k, j);
            const double along = share * (column[0] + dot(pivot + 1, column + 1, below));
            column[0] -= along;
            for (Eigen::Index i = 1; i <= below; ++i)
                column[i] -= along * pivot[i];
        }
        pivot[0] = diagonal;
    }
}

/// Triangle of one panel into the rows of `result`.
void panel_triangle(const Eigen::Ref<const Eigen::MatrixXd>& a, Eigen::Ref<Eigen::MatrixXd> result) {
    Eigen::MatrixXd panel = a;
    sort_rows(panel);
    const Eigen::Index rows = std::min(panel.rows(), panel.cols());
    if (panel.size() <= small_panel)
        reflect_small(panel);
    else
        models::householder_in_place(panel);
    result.topRows(rows) = panel.topRows(rows).triangularView<Eigen::Upper>();
    result.bottomRows(result.rows() - rows).setZero();
}

}  // namespace

Eigen::MatrixXd upper_triangle(const Eigen::Ref<const Eigen::MatrixXd>& a) {
    const Eigen::Index columns = a.cols();
    Eigen::MatrixXd result(columns, columns);
    if (a.rows() == 0 || columns == 0) {
        result.setZero();
        return result;
    }
    // A panel of 256 rows and twenty columns takes 40 kB: it stays in the first two caches while it is factorised.
    // At least eight times as many rows as columns, or stacking the R factors costs as much as making them.
    const Eigen::Index height = std::max<Eigen::Index>(256, 8 * columns);
    if (a.rows() <= 2 * height) {
        panel_triangle(a, result);
        return result;
    }
    const Eigen::Index panels = (a.rows() + height - 1) / height;
    Eigen::MatrixXd stacked(panels * columns, columns);
    const auto factorise_panel = [&](Eigen::Index p) {
        const Eigen::Index from = p * a.rows() / panels;
        const Eigen::Index to = (p + 1) * a.rows() / panels;
        panel_triangle(a.middleRows(from, to - from), stacked.middleRows(p * columns, columns));
    };
    // About a million operations: below that waking other threads costs more than it saves.
    if (a.rows() * columns * columns > 500'000)
        oneapi::tbb::parallel_for(Eigen::Index{0}, panels, factorise_panel);
    else
        for (Eigen::Index p = 0; p < panels; ++p)
            factorise_panel(p);
    return upper_triangle(stacked);
}

void add_diagonal(Eigen::MatrixXd& triangle, const Eigen::VectorXd& diagonal) {
    const Eigen::Index q = diagonal.size();
    Eigen::RowVectorXd row(q + 1);
    for (Eigen::Index i = 0; i < q; ++i) {
        row.setZero();
        row[i] = diagonal[i];
        for (Eigen::Index k = i; k < q; ++k) {
            // Divided by the larger one, so that no square leaves the range of a double.
            const double larger = std::max(std::abs(triangle(k, k)), std::abs(row[k]));
            if (!(larger > 0.0)) continue;
            const double x = triangle(k, k) / larger, y = row[k] / larger;
            const double inverse = 1.0 / std::sqrt(x * x + y * y);
            const double c = x * inverse, s = y * inverse;
            for (Eigen::Index j = k; j <= q; ++j) {
                const double above = triangle(k, j);
                triangle(k, j) = c * above + s * row[j];
                row[j] = c * row[j] - s * above;
            }
        }
    }
}

Eigen::Index eliminate(Eigen::Ref<Eigen::MatrixXd> a, Eigen::Index top, Eigen::Index first, const double* limit,
                       Eigen::Index count, Eigen::Index* order) {
    // Plain loops: the matrices are as small as a state, and calls for general ones cost more than the sums.
    const Eigen::Index rows = a.rows();
    const Eigen::Index stride = a.outerStride();
    double* const begin = a.data();
    std::iota(order, order + count, Eigen::Index{0});
    Eigen::Index rank = 0;
    Eigen::Index left = count;  // candidates are order[rank] ... order[left - 1]
    while (rank < left && top + rank < rows) {
        const Eigen::Index row = top + rank;
        const Eigen::Index rest = rows - row;
        double largest = -1.0;
        Eigen::Index best = rank;
        for (Eigen::Index i = rank; i < left;) {
            const double* column = begin + (first + order[i]) * stride + row;
            const double square = dot(column, column, rest);
            const double norm = std::sqrt(square);
            // Also where squares leave the range of a double. False for nan, which must stay visible.
            if (norm <= limit[order[i]] || square < std::numeric_limits<double>::min()) {
                std::rotate(order + i, order + i + 1, order + left);
                --left;
                continue;
            }
            if (!(norm <= largest)) {
                largest = norm;
                best = i;
            }
            ++i;
        }
        if (rank == left) break;
        std::swap(order[best], order[rank]);
        double* const pivot = begin + (first + order[rank]) * stride + row;
        Eigen::Index heaviest = 0;
        for (Eigen::Index k = 1; k < rest; ++k)
            if (std::abs(pivot[k]) > std::abs(pivot[heaviest])) heaviest = k;
        if (heaviest > 0)
            for (Eigen::Index j = first; j < a.cols(); ++j)
                std::swap(begin[j * stride + row], begin[j * stride + row + heaviest]);
        const double diagonal = pivot[0];
        const double norm = std::copysign(largest, diagonal);
        // The pivot column itself holds the reflector while it is used.
        pivot[0] += norm;
        const double factor = 1.0 / (largest * (largest + std::abs(diagonal)));
        for (Eigen::Index j = first; j < a.cols(); ++j) {
            double* const column = begin + j * stride + row;
            if (column == pivot) continue;
            const double share = factor * dot(pivot, column, rest);
            if (share == 0.0) continue;
            for (Eigen::Index k = 0; k < rest; ++k)
                column[k] -= share * pivot[k];
        }
        pivot[0] = -norm;
        std::fill(pivot + 1, pivot + rest, 0.0);
        ++rank;
    }
    const Eigen::Index below = std::max<Eigen::Index>(rows - top - rank, 0);
    for (Eigen::Index i = rank; i < count; ++i)
        a.col(first + order[i]).tail(below).setZero();
    return rank;
}

}  // namespace orbid::estimator
