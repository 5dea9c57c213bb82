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
    std::string along;  ///< the parameter whose marginal it is computed from
    double mean = 0.0;
    double sd = 0.0;
    double median = 0.0;
    double lower95 = 0.0;
    double upper95 = 0.0;
};

/// Marginal of phi(theta) from the nested Laplace marginals of the parameters.
///
/// A monotone function of one parameter has exactly the transformed quantiles. (The others have no slope in its
/// gradient, at all points of the grid.) Otherwise a mixture along the parameter theta_j with which phi correlates
/// most,
///
///     p(phi | y) = integral of p(theta_j | y) t_nu(phi; phi(theta*(theta_j)), g^T C(theta_j) g) d theta_j
///
/// theta* and C where everything else is at its best with theta_j held, g = gradient of phi there, nu degrees of
/// freedom with estimated error parameters (normal without). It is exact for linear functions in linear models,
/// otherwise of first order in the variation of phi at known theta_j.
/// @param estimate   the estimate the marginals belong to.
/// @param marginals  of parameters (others are ignored); more of them give more choice.
[[nodiscard]] DerivedMarginal derived_marginal(const DerivedQuantity& quantity,
                                               const std::vector<FreeParameter>& parameters, const Estimate& estimate,
                                               const std::vector<Marginal>& marginals);

}  // namespace orbid::estimator

#pragma GCC visibility pop
