#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <limits>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "estimator/estimate/estimate.hpp"
#include "estimator/exploration/record_draws.hpp"
#include "estimator/exploration/replication.hpp"
#include "estimator/interface/eigen_layout.hpp"

namespace orbid::estimator {

/// Share of replicates that may fail: beyond it there are no intervals, for those missing may be a whole tail (2.5 %).
inline constexpr double most_failed_replicates = 0.05;
/// The ends of a 95 % interval lie among the values of so many replicates and not beyond them.
inline constexpr std::size_t least_replicates = 39;

/// One quantity over the replicates; nan what is not known.
struct BootstrapQuantity {
    std::string name;  ///< of a parameter or derived quantity; "series.u.scale" of an error scale
    std::string unit;
    double value = 0.0;                                              ///< the estimate
    double sd = std::numeric_limits<double>::quiet_NaN();            ///< of the estimate, by curvature or sandwich
    double bootstrap_sd = std::numeric_limits<double>::quiet_NaN();  ///< of the replicates about their mean
    double bias = std::numeric_limits<double>::quiet_NaN();          ///< their mean minus the estimate
    double bias_error = std::numeric_limits<double>::quiet_NaN();    ///< sd of the bias, by the number of replicates
    double percentile_lower = std::numeric_limits<double>::quiet_NaN();
    double percentile_upper = std::numeric_limits<double>::quiet_NaN();
    double studentised_lower = std::numeric_limits<double>::quiet_NaN();
    double studentised_upper = std::numeric_limits<double>::quiet_NaN();
    std::string remark;  ///< why an interval is missing
};

/// Replicates that failed alike.
struct BootstrapFailure {
    EstimateStatus status = EstimateStatus::failed;
    std::size_t count = 0;
    std::string message;  ///< of the first one
};

struct Bootstrap {
    ErrorDraw kind = ErrorDraw::parametric;
    std::size_t block = 1;                       ///< length of the longest blocks, in records
    std::size_t asked = 0;                       ///< replicates
    std::vector<BootstrapReplicate> replicates;  ///< those that have run, by number
    std::size_t failed = 0;
    std::vector<BootstrapFailure> failures;
    std::string refused;  ///< why there are no intervals at all; empty: there are
    std::vector<BootstrapQuantity> parameters;
    std::vector<BootstrapQuantity> derived;
    std::vector<BootstrapQuantity> errors;  ///< scales that are estimated
    double evaluations = 0.0;               ///< of all replicates, on average
};

struct BootstrapOptions {
    std::size_t replicates = 200;  ///< >= least_replicates
    RecordDrawOptions draws;
    std::vector<BootstrapReplicate> done;  ///< of the same call before: they are not computed again
    /// Called with all replicates so far, in any order, at least so many seconds after the call before; one call at a
    /// time, from any thread. May be empty.
    std::function<void(const std::vector<BootstrapReplicate>& done)> keep;
    double keep_seconds = 5.0;
    std::function<void(std::size_t finished, std::size_t total)> progress;  ///< likewise after every replicate
};

/// Calibrates the intervals of an estimate by simulation: records are drawn anew from it (RecordDraws) and estimated
/// again (Replication). The same result for any number of threads, and whatever was done before.
///
/// A normal, log-normal or joint normal prior of a parameter is a record, too: its mean is drawn anew around the
/// estimate. Other priors stay as they are.
///
///     percentile   quantiles of theta* at 2.5 % and 97.5 %, (N + 1) p by interpolation
///     studentised  [u - t_0.975 sd, u - t_0.025 sd],   t quantiles of (u* - u) / sd*
///
/// u is the coordinate of the parameter (ln where it is positive), ln of error scales, derived quantities themselves.
/// A replicate counts when it ends converged, or singular like the estimate; others are failures.
/// @throws std::invalid_argument for fewer than least_replicates, and as RecordDraws and estimate() do.
/// @throws models::DataError as RecordDraws does.
/// Source: B. Efron and R. J. Tibshirani, An Introduction to the Bootstrap (Chapman and Hall 1993), chapters 12, 13.
[[nodiscard]] Bootstrap bootstrap(const std::vector<FreeParameter>& parameters,
                                  const std::vector<const Residual*>& residuals,
                                  const std::vector<DerivedQuantity>& derived, const EstimateOptions& options,
                                  const Estimate& estimate, const BootstrapOptions& asked);

/// What replicates say of the quantities of an estimate: everything of Bootstrap but its kind and blocks.
[[nodiscard]] Bootstrap bootstrap_summary(const std::vector<FreeParameter>& parameters, const Estimate& estimate,
                                          std::vector<BootstrapReplicate> replicates, std::size_t asked);

}  // namespace orbid::estimator
