#include "periodic/discretisation/cyclic_system.hpp"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "models/arithmetic/triangular_solve.hpp"

namespace orbid::periodic {
namespace {

constexpr double smallest_pivot = 1e-14;  // see CyclicSystem::singular

struct PivotRange {
    double largest = 0.0;
    double smallest = std::numeric_limits<double>::infinity();

    void note(const MatrixXd& r) {
        for (Index i = 0; i < r.cols(); ++i) {
            largest = std::max(largest, std::abs(r(i, i)));
            smallest = std::min(smallest, std::abs(r(i, i)));
        }
    }
};

double power_of_two(double value) {
    return std::exp2(std::floor(std::log2(value)));
}

void validate_blocks(const std::vector<MatrixXd>& factors, const CyclicSystem::Border& border) {
    if (factors.empty()) throw std::invalid_argument("CyclicSystem: no factors, at least one is needed");
    const Index n = factors.front().rows(), p = static_cast<Index>(factors.size()), k = border.rows.rows();
    for (const MatrixXd& factor : factors)
        if (factor.rows() != n || factor.cols() != n || n == 0)
            throw std::invalid_argument("CyclicSystem: factors must be square and of one size");
    if (k > 0 && (border.columns.rows() != n * p || border.columns.cols() != k ||
                  (border.rows.cols() != n && border.rows.cols() != n * p) || border.corner.rows() != k ||
                  border.corner.cols() != k))
        throw std::invalid_argument("CyclicSystem: the border does not fit the factors");
}

/// What block row j holds of d_0 (only the first one does) and tau.
MatrixXd outer_columns(const std::vector<MatrixXd>& factors, const CyclicSystem::Border& border, Index j) {
    const Index n = factors.front().rows(), k = border.rows.rows();
    MatrixXd columns = MatrixXd::Zero(n, n + k);
    if (j == 0) columns.leftCols(n) = -factors[0];
    if (k > 0) columns.rightCols(k) = -border.columns.middleRows(n * j, n);
    return columns;
}

}  // namespace

CyclicSystem::CyclicSystem(const std::vector<MatrixXd>& factors) {
    validate_blocks(factors, {});
    factorise(factors, {});
}

CyclicSystem::CyclicSystem(const std::vector<MatrixXd>& factors, const Border& border, const VectorXd& scale) {
    validate_blocks(factors, border);
    const Index n = factors.front().rows();
    unit_ = VectorXd::Ones(n);
    if (scale.size() > 0) {
        if (scale.size() != n || !(scale.minCoeff() > 0.0) || !scale.allFinite())
            throw std::invalid_argument("CyclicSystem: the scale must hold one finite value > 0 per coordinate");
        unit_ = scale.unaryExpr(&power_of_two);
    }
    std::vector<MatrixXd> own = factors;
    for (MatrixXd& factor : own)
        factor = unit_.cwiseInverse().asDiagonal() * factor * unit_.asDiagonal();
    Border beside = border;
    for (Index j = 0; n * j < beside.columns.rows(); ++j)
        beside.columns.middleRows(n * j, n).array().colwise() /= unit_.array();
    for (Index j = 0; n * j < beside.rows.cols(); ++j)
        beside.rows.middleCols(n * j, n).array().rowwise() *= unit_.transpose().array();
    row_unit_ = VectorXd::Ones(border.rows.rows());
    for (Index i = 0; i < row_unit_.size(); ++i) {
        const double largest =
            std::max(beside.rows.row(i).cwiseAbs().maxCoeff(), beside.corner.row(i).cwiseAbs().maxCoeff());
        if (largest > 0.0 && std::isfinite(largest)) row_unit_(i) = power_of_two(largest);
    }
    beside.rows.array().colwise() /= row_unit_.array();
    beside.corner.array().colwise() /= row_unit_.array();
    factorise(own, beside);
}

void CyclicSystem::factorise(const std::vector<MatrixXd>& factors, const Border& border) {
    n_ = factors.front().rows();
    p_ = static_cast<Index>(factors.size());
    k_ = border.rows.rows();
    PivotRange pivots;

    if (p_ == 1) {
        MatrixXd whole(n_ + k_, n_ + k_);
        whole.topRows(n_) = outer_columns(factors, border, 0);
        whole.topLeftCorner(n_, n_) += MatrixXd::Identity(n_, n_);
        if (k_ > 0) whole.bottomRows(k_) << border.rows, border.corner;
        last_ = models::PivotedFactor(whole);
    } else {
        // The current row block: first (d_0, tau) + next d_{j} = right-hand side, with j eliminated next.
        MatrixXd first = outer_columns(factors, border, 0);
        MatrixXd next = MatrixXd::Identity(n_, n_);
        // The current rows of the border: bottom (d_0, tau) + bottom_next d_j, and their parts for later nodes.
        const bool all_nodes = k_ > 0 && border.rows.cols() == n_ * p_;
        MatrixXd bottom(k_, n_ + k_);
        if (k_ > 0) bottom << border.rows.leftCols(n_), border.corner;
        MatrixXd bottom_next = MatrixXd::Zero(k_, n_);
        if (all_nodes) bottom_next = border.rows.middleCols(n_, n_);
        eliminations_.reserve(static_cast<std::size_t>(std::max<Index>(p_ - 2, 0)));
        for (Index j = 1; j + 1 < p_; ++j) {
            MatrixXd column(2 * n_, n_);
            column << next, -factors[static_cast<std::size_t>(j)];
            Elimination step{models::HouseholderFactor(column), {}, {}, {}};
            MatrixXd rest = MatrixXd::Zero(2 * n_, 2 * n_ + k_);
            rest.topLeftCorner(n_, n_ + k_) = first;
            rest.bottomLeftCorner(n_, n_ + k_) = outer_columns(factors, border, j);
            rest.bottomRightCorner(n_, n_).setIdentity();
            step.qr.apply_transposed_q(rest);
            step.to_first = rest.topLeftCorner(n_, n_ + k_);
            step.to_next = rest.topRightCorner(n_, n_);
            first = rest.bottomLeftCorner(n_, n_ + k_);
            next = rest.bottomRightCorner(n_, n_);
            pivots.note(step.qr.packed());
            if (all_nodes) {
                step.off_rows = bottom_next;
                models::divide_by_upper_in_place(step.off_rows, step.qr.packed().topRows(n_));
                bottom -= step.off_rows * step.to_first;
                bottom_next = border.rows.middleCols(n_ * (j + 1), n_) - step.off_rows * step.to_next;
            }
            eliminations_.push_back(std::move(step));
        }
        MatrixXd corner = MatrixXd::Zero(2 * n_ + k_, 2 * n_ + k_);
        corner.topRows(n_) << next, first;
        corner.middleRows(n_, n_) << -factors[static_cast<std::size_t>(p_ - 1)], outer_columns(factors, border, p_ - 1);
        corner.block(n_, n_, n_, n_) += MatrixXd::Identity(n_, n_);
        if (k_ > 0) corner.bottomRows(k_) << bottom_next, bottom;
        last_ = models::PivotedFactor(corner);
    }
    pivots.note(last_.packed());
    singular_ = !(pivots.smallest > smallest_pivot * pivots.largest);
}

MatrixXd CyclicSystem::solve(const MatrixXd& b) const {
    if (unit_.size() == 0) return solve_scaled(b, last_.packed());
    MatrixXd right = b;
    right.bottomRows(k_).array().colwise() /= row_unit_.array();
    for (Index j = 0; j < p_; ++j)
        right.middleRows(n_ * j, n_).array().colwise() /= unit_.array();
    MatrixXd d = solve_scaled(right, last_.packed());
    for (Index j = 0; j < p_; ++j)
        d.middleRows(n_ * j, n_).array().colwise() *= unit_.array();
    return d;
}

MatrixXd CyclicSystem::solve_scaled(const MatrixXd& b, const MatrixXd& last) const {
    assert(b.rows() == n_ * p_ + k_);
    // ColPivHouseholderQR::solve() leaves pivots at rounding level out: inverse iteration lives on them.
    const auto solved = [&](MatrixXd right) {
        last_.apply_transposed_q(right);
        models::solve_upper_in_place(last, right);
        return last_.permuted(right);
    };
    if (p_ == 1) return solved(b);

    MatrixXd d(b.rows(), b.cols());
    MatrixXd carried = b.topRows(n_);
    MatrixXd bottom = b.bottomRows(k_);
    for (Index j = 1; j + 1 < p_; ++j) {
        MatrixXd both(2 * n_, b.cols());
        both << carried, b.middleRows(n_ * j, n_);
        eliminations_[static_cast<std::size_t>(j - 1)].qr.apply_transposed_q(both);
        d.middleRows(n_ * j, n_) = both.topRows(n_);  // the right-hand side of d_j, until it is solved for below
        carried = both.bottomRows(n_);
        const MatrixXd& off_rows = eliminations_[static_cast<std::size_t>(j - 1)].off_rows;
        if (off_rows.size() > 0) bottom -= off_rows * both.topRows(n_);
    }
    MatrixXd both(2 * n_ + k_, b.cols());
    both << carried, b.middleRows(n_ * (p_ - 1), n_), bottom;
    const MatrixXd ends = solved(both);
    MatrixXd outer(n_ + k_, b.cols());
    outer = ends.bottomRows(n_ + k_);
    d.middleRows(n_ * (p_ - 1), n_) = ends.topRows(n_);
    d.topRows(n_) = outer.topRows(n_);
    if (k_ > 0) d.bottomRows(k_) = outer.bottomRows(k_);
    for (Index j = p_ - 2; j >= 1; --j) {
        const Elimination& step = eliminations_[static_cast<std::size_t>(j - 1)];
        MatrixXd right =
            d.middleRows(n_ * j, n_) - step.to_first * outer - step.to_next * d.middleRows(n_ * (j + 1), n_);
        models::solve_upper_in_place(step.qr.packed().topRows(n_), right);
        d.middleRows(n_ * j, n_) = right;
    }
    return d;
}

VectorXd CyclicSystem::null_vector() const {
    constexpr int steps = 3;
    // A matrix may be singular to the last bit. A pivot of zero stands for one that is lost in rounding.
    MatrixXd last = last_.packed();
    const double least = std::numeric_limits<double>::epsilon() * last.diagonal().cwiseAbs().maxCoeff();
    for (double& pivot : last.diagonal())
        if (!(std::abs(pivot) > least)) pivot = least;
    VectorXd v(n_ * p_ + k_);
    for (Index i = 0; i < v.size(); ++i)
        v(i) = std::sin(1.0 + 37.0 * static_cast<double>(i * i));  // without structure
    for (int step = 0; step < steps; ++step)
        v = solve_scaled(v, last).col(0).stableNormalized();
    for (Index j = 0; unit_.size() > 0 && j < p_; ++j)
        v.segment(n_ * j, n_).array() *= unit_.array();
    return v;
}

}  // namespace orbid::periodic
