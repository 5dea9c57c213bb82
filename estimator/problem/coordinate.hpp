#pragma once

#include <limits>
#include <vector>

#include <Eigen/Core>

#include "estimator/interface/estimate_options.hpp"

namespace orbid::estimator {

/// -ln p of one number in the coordinate in which steps are taken, with derivatives in that coordinate.
struct PriorTerm {
    double value = 0.0;     ///< +infinity outside the support
    double gradient = 0.0;  ///< d value / du
    /// >= 0, for steps: `second` where that is positive, else a reliable curvature (heavy tails, normal densities in
    /// log coordinates far from their mode). It is the part of the second derivative that cannot be negative; for
    /// Student's t and related densities its weight is (dof + 1) / (dof scale^2 + (x - location)^2). Where the
    /// coordinate is linear, its parabola with the true gradient lies above the true -ln p.
    double curvature = 0.0;
    double second = 0.0;  ///< d^2 value / du^2, of either sign, for the full Hessian
};

/// The same for several numbers together, shapes (names) and (names, names).
struct JointPriorTerm {
    double value = 0.0;
    Eigen::VectorXd gradient;
    Eigen::MatrixXd curvature;  ///< positive semidefinite: `second` where that is so, else its part that always is
    Eigen::MatrixXd second;     ///< the true Hessian in u
};

/// The coordinate u of a natural number x in which steps are taken.
///
///     linear  u = x              log10  u = log10 x
///     log     u = ln x           logit  u = ln((x - lower) / (upper - x))
///
/// Priors are densities of x; in u they carry the Jacobian, -ln p(u) = -ln p(x(u)) - ln |dx/du|. A flat prior has no
/// term in u, whatever the coordinate (M8).
struct Coordinate {
    Scale scale = Scale::linear;
    double lower = -std::numeric_limits<double>::infinity();  ///< of logit, finite; others ignore it
    double upper = std::numeric_limits<double>::infinity();   ///< of logit, finite, > lower

    /// u(x); x at the end of a log, log10 or logit coordinate gives an infinite u, x beyond it nan.
    [[nodiscard]] double at(double natural) const;
    [[nodiscard]] double natural(double u) const;  ///< x(u)
    /// dx/du at x: 1, x, x ln 10, (x - lower)(upper - x)/(upper - lower).
    [[nodiscard]] double slope(double natural) const;
    [[nodiscard]] PriorTerm term(const Prior& prior, double u) const;

    /// Width of a proper prior in u, finite and positive; infinite for flat.
    ///
    /// The sd in u. Exact where it is known (log-normal, gamma, half-normal, half-Cauchy in log coordinates, any prior
    /// in a linear one), by the slope at `natural` otherwise. Where a density has no sd: that of the normal density
    /// with the same quartiles.
    [[nodiscard]] double prior_sd(const Prior& prior, double natural) const;

    /// A change of x by max(|x|, typical) expressed in u (to first order): 1 for log. The unit of null directions.
    [[nodiscard]] double size(double natural, double typical) const;
};

/// 1 / (1 + exp(-u)), both tails to full relative accuracy.
[[nodiscard]] double logistic(double u);

/// The coordinate of a parameter: its scale and, for logit, its bounds.
[[nodiscard]] Coordinate coordinate_of(const FreeParameter& parameter);

/// Joint normal prior in the coordinates of its parameters, in the order of its names.
/// @param u  shape (names).
[[nodiscard]] JointPriorTerm joint_term(const JointNormalPrior& prior, const std::vector<Coordinate>& coordinates,
                                        const Eigen::VectorXd& u);

}  // namespace orbid::estimator
