#pragma once

#include <functional>

#include <Eigen/Core>

#include "estimator/interface/eigen_layout.hpp"

#pragma GCC visibility push(default)

namespace orbid::estimator {

/// -ln p(x) up to a constant. The gradient, shape (x.size()), is written unless it is null.
///
/// +infinity or nan = cannot be evaluated there; the gradient is then ignored. Must be callable from several threads at
/// once and give the same bits for the same x.
using NegativeLogDensity = std::function<double(const Eigen::VectorXd& x, Eigen::VectorXd* gradient)>;

/// A place and a momentum of the fictitious particle that explores a density p(x).
///
///     H = -ln p(x) + |r|^2 / 2,      dx/dt = L r,      dr/dt = -L^T grad(-ln p),      metric M = L L^T
///
/// r = L^T p is the momentum p ~ N(0, M^-1) in units in which it is standard normal. With M near the covariance of x
/// all directions have the same period, and scalar products need no metric.
struct PhasePoint {
    Eigen::VectorXd x;
    Eigen::VectorXd r;
    Eigen::VectorXd gradient;  ///< of -ln p at x
    double potential = 0.0;    ///< -ln p at x, +infinity where it cannot be evaluated

    [[nodiscard]] double energy() const { return potential + 0.5 * r.squaredNorm(); }
};

/// Evaluates potential and gradient at point.x; anything that is not finite makes the potential +infinity.
void evaluate(const NegativeLogDensity& density, PhasePoint& point);

/// One leapfrog step (kick, drift, kick) of length `step`, negative = backwards in time: reversible, volume preserving,
/// energy error O(step^2) over a fixed time. Costs one evaluation.
///
/// @param factor  L, lower triangular, shape (dimension, dimension). Where the new place cannot be evaluated its
/// potential is +infinity and the second kick is left out. Source: Hoffman and Gelman, J. Machine Learning Research 15
/// (2014) 1593, algorithm 1, in the momentum r.
void leapfrog(const NegativeLogDensity& density, const Eigen::MatrixXd& factor, double step, PhasePoint& point);

}  // namespace orbid::estimator

#pragma GCC visibility pop
