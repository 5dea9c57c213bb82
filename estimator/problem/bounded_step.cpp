#include "estimator/problem/bounded_step.hpp"

#include <algorithm>
#include <cmath>

#include "models/arithmetic/triangular_solve.hpp"

namespace orbid::estimator {

namespace {

/// A multiplier below this fraction of the size of the residuals is rounding: it does not free a parameter.
constexpr double multiplier_tolerance = 1e-12;

/// The unbounded minimum over the free parameters, the others held at d.
Eigen::VectorXd free_minimum(const ReducedProblem& reduced_problem, const PriorModel& prior, double mu,
                             const Eigen::VectorXd& damping, const Eigen::VectorXd& fallback, double tolerance,
                             const Eigen::VectorXd& held, BoundedStep& step) {
    const auto count = static_cast<Eigen::Index>(step.free.size());
    const Eigen::MatrixXd r = reduced_problem.r(Eigen::all, step.free);
    Eigen::VectorXd rest = held;
    for (const Eigen::Index parameter : step.free)
        rest[parameter] = 0.0;
    const Eigen::VectorXd rhs = reduced_problem.rhs + reduced_problem.r * rest;
    const Eigen::MatrixXd own = prior.rows(Eigen::all, step.free);
    step.space = split(r, own, fallback(step.free), tolerance);
    const Subspace& space = step.space;
    const Eigen::Index data = space.data.cols();
    const Eigen::Index rank = data + space.prior.cols();
    if (rank == 0) return Eigen::VectorXd::Zero(count);

    const Eigen::VectorXd inverse_unit = space.unit.cwiseInverse();
    Eigen::MatrixXd basis(count, rank);
    basis << space.data, space.prior;
    const Eigen::MatrixXd prior_rows = own * inverse_unit.asDiagonal() * basis;
    const Eigen::Index rows = own.rows();
    const Eigen::Index seen = space.rows.rows();
    const Eigen::Index damped = mu > 0.0 ? count + space.prior.cols() : 0;
    Eigen::MatrixXd stacked = Eigen::MatrixXd::Zero(seen + rows + damped, rank + 1);
    stacked.topLeftCorner(seen, data) = space.rows;
    stacked.topRightCorner(seen, 1) = rhs;
    stacked.block(seen, 0, rows, rank) = prior_rows;
    // What the prior pulls at, held parameters included.
    stacked.block(seen, rank, rows, 1) = prior.rows * rest;
    if (mu > 0.0) {
        const double root = std::sqrt(mu);
        const Eigen::VectorXd own_damping = damping(step.free);
        stacked.block(seen + rows, 0, count, data) =
            (root * own_damping.cwiseProduct(inverse_unit)).asDiagonal() * space.data;
        stacked.block(seen + rows + count, data, space.prior.cols(), space.prior.cols()).diagonal() =
            root * prior_rows.rightCols(space.prior.cols()).colwise().norm().transpose();
    }
    const Eigen::MatrixXd factor = upper_triangle(std::move(stacked));
    const Eigen::VectorXd gradient = prior.gradient(step.free);
    Eigen::VectorXd y = basis.transpose() * gradient.cwiseProduct(inverse_unit);
    models::solve_transposed_upper_in_place(factor.topLeftCorner(rank, rank), y);
    y = -(y + factor.topRightCorner(rank, 1));
    models::solve_upper_in_place(factor.topLeftCorner(rank, rank), y);
    return inverse_unit.cwiseProduct(basis * y);
}

/// The held parameter that the objective pulls inward most; -1: none.
Eigen::Index pulled_inward(const ReducedProblem& reduced_problem, const PriorModel& prior,
                           const Eigen::VectorXd& gradient, const std::vector<int>& active, double size) {
    double strongest = 0.0;
    Eigen::Index freed = -1;
    for (Eigen::Index i = 0; i < gradient.size(); ++i) {
        const int side = active[static_cast<std::size_t>(i)];
        if (side == 0) continue;
        const double norm = std::max(reduced_problem.r.col(i).norm(), prior.rows.col(i).norm());
        const double inward = (side < 0 ? -gradient[i] : gradient[i]) / std::max(norm, 1e-300);
        if (inward > multiplier_tolerance * size && inward > strongest) {
            strongest = inward;
            freed = i;
        }
    }
    return freed;
}

void describe_decided(BoundedStep& step) {
    // What the last set of free parameters decides, as a basis over all parameters.
    step.decided = Eigen::MatrixXd::Zero(step.d.size(), step.space.data.cols() + step.space.prior.cols());
    step.decided(step.free, Eigen::all) = step.space.decided();
    step.seen = step.d;
    const Eigen::VectorXd own = step.d(step.free);
    const Eigen::VectorXd moved = step.space.unit.cwiseProduct(own);
    const Eigen::VectorXd unseen =
        step.space.unit.cwiseInverse().cwiseProduct(step.space.prior * (step.space.prior.transpose() * moved));
    step.seen(step.free) -= unseen;
    step.from_data = step.decided;
    step.from_data.rightCols(step.space.prior.cols()).setZero();
}

}  // namespace

BoundedStep bounded_step(const ReducedProblem& reduced_problem, const PriorModel& prior, const StepBounds& bounds,
                         double mu, const Eigen::VectorXd& damping, const Eigen::VectorXd& fallback,
                         double rank_tolerance) {
    const Eigen::Index q = reduced_problem.rhs.size();
    BoundedStep step;
    step.d = Eigen::VectorXd::Zero(q);
    step.active.assign(static_cast<std::size_t>(q), 0);
    for (Eigen::Index i = 0; i < q; ++i) {
        if (!(bounds.lower[i] < 0.0)) step.active[static_cast<std::size_t>(i)] = -1;
        if (!(bounds.upper[i] > 0.0)) step.active[static_cast<std::size_t>(i)] = 1;
    }
    const double size = std::hypot(reduced_problem.rest, reduced_problem.rhs.norm());
    // Each pass either holds or frees one parameter; the objective falls strictly between two freeings, so it ends.
    // The limit guards against cycling by rounding.
    const int passes = 20 * static_cast<int>(q) + 20;
    for (int pass = 0; pass < passes; ++pass) {
        step.free.clear();
        for (Eigen::Index i = 0; i < q; ++i)
            if (step.active[static_cast<std::size_t>(i)] == 0) step.free.push_back(i);
        const Eigen::VectorXd target =
            free_minimum(reduced_problem, prior, mu, damping, fallback, rank_tolerance, step.d, step);
        // Go there, or to the first bound on the way.
        double share = 1.0;
        Eigen::Index hit = -1;
        for (std::size_t k = 0; k < step.free.size(); ++k) {
            const Eigen::Index i = step.free[k];
            const double move = target[static_cast<Eigen::Index>(k)] - step.d[i];
            const double room = move < 0.0 ? bounds.lower[i] - step.d[i] : bounds.upper[i] - step.d[i];
            if (std::abs(move) > std::abs(room) && std::abs(room) < share * std::abs(move)) {
                share = std::abs(room) / std::abs(move);
                hit = i;
            }
        }
        for (std::size_t k = 0; k < step.free.size(); ++k) {
            const Eigen::Index i = step.free[k];
            step.d[i] += share * (target[static_cast<Eigen::Index>(k)] - step.d[i]);
        }
        if (hit >= 0) {
            const bool lower = std::abs(step.d[hit] - bounds.lower[hit]) < std::abs(step.d[hit] - bounds.upper[hit]);
            step.active[static_cast<std::size_t>(hit)] = lower ? -1 : 1;
            step.d[hit] = lower ? bounds.lower[hit] : bounds.upper[hit];
            continue;
        }
        // At the minimum for this set: free the held parameter that the objective pulls inward most.
        Eigen::VectorXd gradient = reduced_problem.r.transpose() * (reduced_problem.r * step.d + reduced_problem.rhs) +
                                   prior.gradient + prior.rows.transpose() * (prior.rows * step.d);
        if (mu > 0.0) gradient += mu * damping.cwiseAbs2().cwiseProduct(step.d);
        const Eigen::Index freed = pulled_inward(reduced_problem, prior, gradient, step.active, size);
        if (freed < 0) break;
        step.active[static_cast<std::size_t>(freed)] = 0;
    }
    describe_decided(step);
    return step;
}

}  // namespace orbid::estimator
