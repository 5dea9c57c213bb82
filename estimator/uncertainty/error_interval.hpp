#pragma once

#include <utility>

#include <Eigen/Core>

#include "estimator/minimisation/error_parameter.hpp"

namespace orbid::estimator {

/// Ends of the interval of 95 % of one error parameter in its coordinate, by likelihood:
///
///     { psi_k : 2 [min Phi_psi - Phi_psi(estimate)] <= 1.96^2 },   the minimum over all other error parameters
///
/// with Phi_psi of the problem, the restricted one by default. The likelihood of a correlation is lopsided in every
/// coordinate where records are few: normal in atanh it covers 94 to 83 per cent (80 records, 0.6 to 0.9), by
/// likelihood 94 to 95. An end that is not reached within the limits is the limit; nan where minima fail.
/// @param psi  at the minimum, shape (error parameters); @param k  free; @param sd  of psi_k by Laplace, > 0.
/// @param floor, ceiling  limits of psi.
/// Source: signed root, as in profiles(); Cox and Hinkley, Theoretical statistics (1974), section 9.3.
[[nodiscard]] std::pair<double, double> error_interval(ErrorProblem problem, const Eigen::VectorXd& psi, Eigen::Index k,
                                                       double sd, const Eigen::VectorXd& floor,
                                                       const Eigen::VectorXd& ceiling);

}  // namespace orbid::estimator
