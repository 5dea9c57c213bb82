#pragma once

#include <vector>

#include "estimator/estimate/estimate.hpp"
#include "identification/problem/problem_residuals.hpp"

namespace orbid::identification {

/// Whether the links of a series err by a process noise that is estimated.
[[nodiscard]] bool has_process_noise(const ProblemResiduals& residuals);

/// An estimate with process noise: the maximum of the marginal likelihood over parameters and scales, states integrated
/// out by Laplace's method; exact for linear models.
///
/// estimate() minimises Phi over parameters and states together. The integral over states adds ln|H| / 2, whose slope
/// moves parameters where noise is large: a damping of 0.3 by 2.6 sds, in the mean of 40 records. Here the slope g is
/// found by central differences of a tenth of a sd, with the states following, and g theta is added to the objective,
/// as a normal prior 300 sds wide and as far away as gives this slope. Both are repeated until parameters move by less
/// than 1e-4 sds. Without a coordinate whose noise is above its bound nothing is added.
/// @throws orbits::DataError  a parameter has a prior of its own.
[[nodiscard]] estimator::Estimate estimate_with_noise(const std::vector<estimator::FreeParameter>& parameters,
                                                      const ProblemResiduals& residuals,
                                                      const std::vector<estimator::DerivedQuantity>& derived,
                                                      const estimator::EstimateOptions& options);

}  // namespace orbid::identification
