#pragma once

#include <Eigen/Core>

#include "estimator/minimisation/minimum.hpp"
#include "estimator/uncertainty/posterior.hpp"

namespace orbid::estimator {

/// dx/du of every parameter, shape (q).
[[nodiscard]] Eigen::VectorXd slopes(const Problem& problem, const Eigen::VectorXd& theta);

/// Interval of 95 % of a parameter, with its method: never beyond bounds, see bounded_interval(). Of a parameter that
/// rests on a bound: that of the normal density, or t, if it were released, cut there; a sandwich widens it
/// as much as it widens the free parameters at most, or without any by the correlation time of the residuals. None
/// where the data tell not even the order of magnitude.
void fill_interval(const Problem& problem, const State& state, const Minimum& minimum, const Posterior& posterior,
                   Eigen::Index parameter, Estimated& result);

/// Ends of a derived quantity: its values where the joint direction that changes it most, in sds, meets the ends of the
/// interval along it. So a quantity that keeps its sign keeps it here too, and no parameter leaves its bounds. Where
/// the quantity is not monotone on the way: to first order.
/// @param gradient  of the quantity in u, shape (q).
void fill_interval(const Problem& problem, const State& state, const Posterior& posterior,
                   const DerivedQuantity& quantity, const Eigen::VectorXd& gradient, Estimated& result);

/// Interval of 95 % of an error scale from its sd: s sqrt(nu / chi2_nu), nu = 1 / (2 sd(ln s)^2). Exact for one scale
/// of a linear model, where nu = n - q. None without a finite nu.
void fill_interval(EstimatedScale& scale);

}  // namespace orbid::estimator
