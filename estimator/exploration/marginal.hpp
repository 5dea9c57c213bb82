#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "estimator/estimate/estimate.hpp"
#include "estimator/interface/eigen_layout.hpp"

#pragma GCC visibility push(default)

namespace orbid::estimator {

struct MarginalOptions {
    double step = 0.5;  ///< between points, in sds, > 0; half of it where the density falls by more than e^2 a step
    /// The grid ends where ln of the density is this far below its maximum, > 0. e^-12 leaves out 1e-6 of the
    /// probability of a normal density.
    double fall = 12.0;
    double reach = 40.0;      ///< and this many sds from the estimate at the latest, > 0: heavy tails
    int maximum_points = 41;  ///< to each side, > 0
    /// Whether the inner determinants are those of the full Hessian, 2 q further evaluations per point. The
    /// Gauss-Newton one misses how a curved model widens or narrows. Empty: when there are at most 12 parameters.
    std::optional<bool> full_hessian;
    std::vector<std::string> names;  ///< which unknowns: parameters, "group.scale", "group.dof" ...; empty: all
    /// Called after every unknown, one call at a time; may be empty.
    std::function<void(int finished, int total)> progress{};
};

/// Why a grid ends on a side. reach: the density has not fallen (improper, or a very heavy tail). What lies beyond is
/// left out; mean and sd in particular may not exist. failed: points further out cannot be evaluated.
enum class MarginalEnd { fallen, bound, reach, failed, interrupted };
[[nodiscard]] std::string_view name(MarginalEnd end);

struct MarginalPoint {
    double u = 0.0;            ///< coordinate
    double value = 0.0;        ///< natural
    double log_density = 0.0;  ///< in u, normalised
    Eigen::VectorXd theta;     ///< where the other parameters are at their best, all parameters, natural
};

/// Posterior of one unknown with everything else integrated out.
struct Marginal {
    std::string name;
    std::string unit;
    bool known = false;   ///< false: see message; the numbers are nan
    std::string message;  ///< names what to keep in mind
    double mean = 0.0;    ///< natural units, as all below
    double sd = 0.0;
    double median = 0.0;
    double lower95 = 0.0;  ///< quantiles 2.5 and 97.5 %
    double upper95 = 0.0;
    MarginalEnd lower_end = MarginalEnd::fallen;
    MarginalEnd upper_end = MarginalEnd::fallen;
    bool full_hessian = false;
    std::vector<MarginalPoint> points;  ///< ascending in u
    int failed_points = 0;
    int evaluations = 0;
};

/// Nested Laplace: the marginal posterior density of every parameter and error parameter.
///
///     ln p(u_j | y) = ln of the integral over all other coordinates at fixed u_j (Laplace) + ln p(u_j) + constant
///
/// on a grid that follows the density, cubic spline of ln p between, moments and quantiles by quadrature in natural
/// units. theta and latent states are integrated at fixed error parameters, these around their own conditional mode.
/// Exact where the conditional densities are normal (linear models: t marginals with an unknown scale); the error is of
/// second order in their departure from it. Where sd and laplace_sd of the estimate differ (sandwich, slack), ln p is
/// divided by the square of their ratio, the prior included: table and marginal agree. An unknown for which the
/// estimate has too few independent values has no marginal. Unknowns are computed in parallel; the same result for any
/// number of threads.
/// @param estimate  the estimate of the same parameters, residuals and options; residuals are not changed.
/// @throws models::DataError for names of what is not estimated
/// @throws std::invalid_argument for options out of range, an estimate that failed or is of other parameters
[[nodiscard]] std::vector<Marginal> marginals(const std::vector<FreeParameter>& parameters,
                                              const std::vector<const Residual*>& residuals,
                                              const EstimateOptions& options, const Estimate& estimate,
                                              const MarginalOptions& marginal = {});

}  // namespace orbid::estimator

#pragma GCC visibility pop
