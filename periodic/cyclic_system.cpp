#include "periodic/cyclic_system.hpp"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <limits>
#include <stdexcept>

namespace orbid::periodic {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;

constexpr double smallest_pivot = 1e-14;  // see CyclicSystem::singular

}  // namespace

CyclicSystem::CyclicSystem(const std::vector<MatrixXd>& factors) {
    if (factors.empty()) throw std::invalid_argument("CyclicSystem: no factors, at least one is needed");
    n_ = factors.front().rows();
    p_ = static_cast<Index>(factors.size());
    for (const MatrixXd& factor : factors)
        if (factor.rows() != n_ || factor.cols() != n_ || n_ == 0)
            throw std::invalid_argument("CyclicSystem: factors must be square and of one size");

    double largest = 0.0;
    double smallest = std::numeric_limits<double>::infinity();
    const auto note_pivots = [&](const MatrixXd& r) {
        for (Index i = 0; i < r.cols(); ++i) {
            largest = std::max(largest, std::abs(r(i, i)));
            smallest = std::min(smallest, std::abs(r(i, i)));
        }
    };

    if (p_ == 1) {
        last_.compute(MatrixXd::Identity(n_, n_) - factors[0]);
    } else {
        // The row block at hand: first d_0 + next d_{j} = right-hand side, with j the next to go.
        MatrixXd first = -factors[0];
        MatrixXd next = MatrixXd::Identity(n_, n_);
        eliminations_.reserve(static_cast<std::size_t>(std::max<Index>(p_ - 2, 0)));
        for (Index j = 1; j + 1 < p_; ++j) {
            MatrixXd column(2 * n_, n_);
            column << next, -factors[static_cast<std::size_t>(j)];
            Elimination step{Eigen::HouseholderQR<MatrixXd>(column), {}, {}};
            MatrixXd rest = MatrixXd::Zero(2 * n_, 2 * n_);
            rest.topLeftCorner(n_, n_) = first;
            rest.bottomRightCorner(n_, n_).setIdentity();
            rest.applyOnTheLeft(step.qr.householderQ().adjoint());
            step.to_first = rest.topLeftCorner(n_, n_);
            step.to_next = rest.topRightCorner(n_, n_);
            first = rest.bottomLeftCorner(n_, n_);
            next = rest.bottomRightCorner(n_, n_);
            note_pivots(step.qr.matrixQR());
            eliminations_.push_back(std::move(step));
        }
        MatrixXd corner(2 * n_, 2 * n_);
        corner << next, first, -factors[static_cast<std::size_t>(p_ - 1)], MatrixXd::Identity(n_, n_);
        last_.compute(corner);
    }
    note_pivots(last_.matrixQR());
    singular_ = !(smallest > smallest_pivot * largest);
}

MatrixXd CyclicSystem::solve(const MatrixXd& b) const {
    assert(b.rows() == n_ * p_);
    if (p_ == 1) return last_.solve(b);

    MatrixXd d(b.rows(), b.cols());
    MatrixXd carried = b.topRows(n_);
    for (Index j = 1; j + 1 < p_; ++j) {
        MatrixXd both(2 * n_, b.cols());
        both << carried, b.middleRows(n_ * j, n_);
        both.applyOnTheLeft(eliminations_[static_cast<std::size_t>(j - 1)].qr.householderQ().adjoint());
        d.middleRows(n_ * j, n_) = both.topRows(n_);  // the right-hand side of d_j, until it is solved for below
        carried = both.bottomRows(n_);
    }
    MatrixXd both(2 * n_, b.cols());
    both << carried, b.bottomRows(n_);
    const MatrixXd ends = last_.solve(both);
    d.bottomRows(n_) = ends.topRows(n_);
    d.topRows(n_) = ends.bottomRows(n_);
    for (Index j = p_ - 2; j >= 1; --j) {
        const Elimination& step = eliminations_[static_cast<std::size_t>(j - 1)];
        MatrixXd right =
            d.middleRows(n_ * j, n_) - step.to_first * d.topRows(n_) - step.to_next * d.middleRows(n_ * (j + 1), n_);
        step.qr.matrixQR().topRows(n_).triangularView<Eigen::Upper>().solveInPlace(right);
        d.middleRows(n_ * j, n_) = right;
    }
    return d;
}

}  // namespace orbid::periodic
