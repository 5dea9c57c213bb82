#pragma once

#include <vector>

#include <Eigen/Core>

#include "estimator/algebra/block_arrow.hpp"
#include "estimator/algebra/subspace.hpp"

namespace orbid::estimator {

/// Prior of all parameters in coordinates u, to second order.
struct PriorModel {
    double value = 0.0;
    Eigen::VectorXd gradient;  ///< shape (q)
    Eigen::MatrixXd rows;      ///< shape (any, q): rows^T rows is the curvature, positive semidefinite
    Eigen::MatrixXd second;    ///< true second derivatives, shape (q, q)

    /// d^T curvature d.
    [[nodiscard]] double quadratic(const Eigen::VectorXd& d) const {
        return rows.rows() > 0 ? (rows * d).squaredNorm() : 0.0;
    }
};

/// Range of a step: lower <= d <= upper (inclusive, may be infinite), relative to the present point.
struct StepBounds {
    Eigen::VectorXd lower;  ///< <= 0
    Eigen::VectorXd upper;  ///< >= 0
};

/// A step of (M11) and the bounds it rests on.
struct BoundedStep {
    Eigen::VectorXd d;          ///< shape (q)
    Eigen::VectorXd seen;       ///< part of d that the data determine, shape (q); the prior alone determines the rest
    std::vector<int> active;    ///< -1 at the lower, +1 at the upper bound and pushed against it, else 0
    Eigen::MatrixXd decided;    ///< basis of the free directions that data or prior determine, shape (q, rank)
    Eigen::MatrixXd from_data;  ///< determined, with the columns of data-null directions set to zero
    Subspace space;             ///< of the free parameters, see `free`
    std::vector<Eigen::Index> free;
};

/// Minimises 1/2 ||r d + rhs||^2 + g^T d + 1/2 d^T h d + 1/2 mu ||D d||^2 within bounds, by an active set that can
/// leave a bound again. Undetermined directions are not moved.
///
/// @param reduced_problem  the data, latent states eliminated.
/// @param damping    D, shape (q), > 0; does not act on directions that only the prior decides: there the quadratic
///                   model is exact, and damping in units of the data would freeze them.
/// @param fallback   shape (q), see split().
[[nodiscard]] BoundedStep bounded_step(const ReducedProblem& reduced_problem, const PriorModel& prior,
                                       const StepBounds& bounds, double mu, const Eigen::VectorXd& damping,
                                       const Eigen::VectorXd& fallback, double rank_tolerance);

}  // namespace orbid::estimator
