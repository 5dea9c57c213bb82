#pragma once

#include <cstddef>
#include <vector>

#include <Eigen/Core>

#include "estimator/estimate/estimate.hpp"
#include "estimator/exploration/record_draws.hpp"
#include "estimator/interface/eigen_layout.hpp"

namespace orbid::estimator {

/// Mean error of an estimate, by records with further errors.
struct SimulatedBias {
    Eigen::VectorXd value;  ///< natural units, shape (parameters); nan without a pair
    Eigen::VectorXd error;  ///< its sd by the number of pairs; nan of a single one
    std::size_t pairs = 0;  ///< those of which both estimates have converged
};

/// Errors of half the variance of the record's own are added to the record as it was read. What that does to the
/// estimate, twice, is what the record's own errors have done: bias grows with their variance. The course stays the
/// one that made the record. One drawn anew from the estimate has the estimated course, and at errors of 2e-2 of the
/// range shows half of the bias of a chaotic series.
///
/// Errors are added in pairs of opposite signs. In the mean of a pair all that is linear in them cancels, so that few
/// pairs tell the bias. Where no pair converges twice as many are tried once more. Estimates begin at the given one
/// (Replication), and end where a hundredth of a sd is left. They run at once, of long series one after the other. The
/// same result for any number of threads.
/// @param draws  its `added` is not read.
/// @throws std::invalid_argument, models::DataError as RecordDraws and estimate() do.
/// Source: simulation and extrapolation, J. R. Cook, L. A. Stefanski, J. Am. Stat. Assoc. 89:1314-1328 (1994);
/// antithetic resampling, P. Hall, Biometrika 76:713-724 (1989).
[[nodiscard]] SimulatedBias simulated_bias(const std::vector<FreeParameter>& parameters,
                                           const std::vector<const Residual*>& residuals,
                                           const EstimateOptions& options, const Estimate& estimate, std::size_t pairs,
                                           const RecordDrawOptions& draws);

/// A bias beyond so many sds is no correction: the estimate stays as it is.
inline constexpr double largest_bias = 4.0;

/// The estimate less its bias by simulation, with states, scales and intervals that belong to it.
///
/// States that follow a chaotic record are nonlinear in its errors, and there are the more of them the longer the
/// record is. The bias they give to parameters does not become smaller with the length, while sds do. Here the
/// objective gets the slope (Estimate::tilt) that moves its minimum by the bias, to a twentieth of a sd, or a quarter
/// where courses fold and steps end earlier. The values of the estimate's objective and likelihood are without it.
///
/// Parameters with a prior of their own or a joint one, and those that would pass a bound, have no slope; they follow
/// the others.
///
/// An estimate that has not converged is returned as it is. So is one without a pair, with a bias beyond
/// `largest_bias`, or whose minimisation with the slope does not converge: `message` and `bias_left` say why. One that
/// is stopped meanwhile has the status `interrupted`.
[[nodiscard]] Estimate unbiased(const std::vector<FreeParameter>& parameters,
                                const std::vector<const Residual*>& residuals,
                                const std::vector<DerivedQuantity>& derived, const EstimateOptions& options,
                                const Estimate& estimate, std::size_t pairs, const RecordDrawOptions& draws);

}  // namespace orbid::estimator
