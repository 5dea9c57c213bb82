#include "estimator/triangle.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

#include <oneapi/tbb/parallel_for.h>
#include <Eigen/QR>

namespace orbid::estimator {

namespace {

/// Row sizes that differ by less do not need sorting: at most three digits of the lightest row are at stake, and
/// unsorted problems of one scale are the common, time-critical ones.
constexpr double mixed_weights = 1e3;

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

/// Triangle of one panel into the rows of `result`.
void panel_triangle(const Eigen::Ref<const Eigen::MatrixXd>& a, Eigen::Ref<Eigen::MatrixXd> result) {
    Eigen::MatrixXd panel = a;
    sort_rows(panel);
    const Eigen::Index rows = std::min(panel.rows(), panel.cols());
    const Eigen::HouseholderQR<Eigen::Ref<Eigen::MatrixXd>> qr(panel);
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
    // At least eight times as many rows as columns, or stacking the triangles costs as much as making them.
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

PivotedColumns eliminate(Eigen::MatrixXd& a, Eigen::Index top, Eigen::Index first, const Eigen::VectorXd& limit) {
    PivotedColumns columns;
    columns.order.resize(static_cast<std::size_t>(limit.size()));
    std::iota(columns.order.begin(), columns.order.end(), Eigen::Index{0});
    const auto begin = columns.order.begin();
    Eigen::VectorXd v(a.rows());
    std::size_t left = columns.order.size();  // candidates are order[rank] ... order[left - 1]
    while (static_cast<std::size_t>(columns.rank) < left && top + columns.rank < a.rows()) {
        const Eigen::Index row = top + columns.rank;
        const Eigen::Index rest = a.rows() - row;
        double largest = -1.0;
        auto best = begin;
        for (auto i = static_cast<std::size_t>(columns.rank); i < left;) {
            const double norm = a.col(first + columns.order[i]).tail(rest).norm();
            if (norm <= limit[columns.order[i]]) {  // false for nan, which must stay visible
                std::rotate(begin + static_cast<std::ptrdiff_t>(i), begin + static_cast<std::ptrdiff_t>(i) + 1,
                            begin + static_cast<std::ptrdiff_t>(left));
                --left;
                continue;
            }
            if (!(norm <= largest)) {
                largest = norm;
                best = begin + static_cast<std::ptrdiff_t>(i);
            }
            ++i;
        }
        if (static_cast<std::size_t>(columns.rank) == left) break;
        std::swap(*best, columns.order[static_cast<std::size_t>(columns.rank)]);
        const Eigen::Index pivot = first + columns.order[static_cast<std::size_t>(columns.rank)];
        Eigen::Index heaviest = 0;
        a.col(pivot).tail(rest).cwiseAbs().maxCoeff(&heaviest);
        if (heaviest > 0) a.row(row).tail(a.cols() - first).swap(a.row(row + heaviest).tail(a.cols() - first));
        const double diagonal = a(row, pivot);
        const double norm = std::copysign(largest, diagonal);
        auto reflector = v.head(rest);
        reflector = a.col(pivot).tail(rest);
        reflector[0] += norm;
        const double factor = 1.0 / (largest * (largest + std::abs(diagonal)));
        for (Eigen::Index j = first; j < a.cols(); ++j) {
            if (j == pivot) continue;
            auto column = a.col(j).tail(rest);
            const double share = factor * reflector.dot(column);
            if (share != 0.0) column -= share * reflector;
        }
        a(row, pivot) = -norm;
        a.col(pivot).tail(rest - 1).setZero();
        ++columns.rank;
    }
    const Eigen::Index below = std::max<Eigen::Index>(a.rows() - top - columns.rank, 0);
    for (auto i = static_cast<std::size_t>(columns.rank); i < columns.order.size(); ++i)
        a.col(first + columns.order[i]).tail(below).setZero();
    return columns;
}

}  // namespace orbid::estimator
