#pragma once

#include <vector>

#include "estimator/estimate/estimate.hpp"
#include "estimator/exploration/marginal.hpp"

#pragma GCC visibility push(default)

namespace orbid::estimator {

/// Posterior of a quantity computed from the parameters.
struct DerivedMarginal {
    std::string name;
    bool known = false;
    std::string message;  ///< why not
    /// "transformed": of one parameter alone and monotone, its marginal transformed. "mixture": see derived_marginal().
    std::string method;
    std::string along;  ///< the parameter whose marginal carries it
    double mean = 0.0;
    double sd = 0.0;
    double median = 0.0;
    double lower95 = 0.0;
    double upper95 = 0.0;
};

/// Marginal of phi(theta) from the nested Laplace marginals of the parameters.
///
/// A monotone function of one parameter (the others have no slope in its gradient, at all points of the grid) has
/// exactly the transformed quantiles. Otherwise a mixture along the parameter theta_j with which phi correlates most,
///
///     p(phi | y) = integral of p(theta_j | y) t_nu(phi; phi(theta*(theta_j)), g^T C(theta_j) g) d theta_j
///
/// theta* and C where everything else is at its best with theta_j held, g = gradient of phi there, nu degrees of
/// freedom with estimated error parameters (normal without): exact for linear functions in linear models, first order
/// in what is left of phi once theta_j is known.
/// @param estimate   the estimate the marginals belong to.
/// @param marginals  of parameters (others are passed over); more of them give more choice.
[[nodiscard]] DerivedMarginal derived_marginal(const DerivedQuantity& quantity,
                                               const std::vector<FreeParameter>& parameters, const Estimate& estimate,
                                               const std::vector<Marginal>& marginals);

}  // namespace orbid::estimator

#pragma GCC visibility pop
