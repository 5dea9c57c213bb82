#pragma once

#include <string>
#include <vector>

#include <Eigen/Core>

#include "orbits/series_residuals/shooting_residual.hpp"

namespace orbid::orbits {

/// Evidence against an estimate from its matching: larger defects than allowed, and estimates that move when it is
/// looser.
struct ContinuityReport {
    Eigen::VectorXd sd;               ///< matching sds at the end, shape (n)
    ShootingResidual::Defect defect;  ///< against them
    /// Share of intervals that would be large if the errors of matching were as assumed; 0 for exact matching.
    double expected = 0.0;
    double noise = 0.0;      ///< largest sd of a reading over its range
    Eigen::VectorXd looser;  ///< sds of the second estimate; empty without one
    /// Per parameter: the estimate minus that at looser matching, in sds of this difference (Hausman: the variance of
    /// the difference of an efficient and a less efficient estimate is the difference of their variances). Normal with
    /// sd 1 when model and intervals are right.
    Eigen::VectorXd shift;
    std::vector<std::string> warnings;  ///< complete sentences; empty without evidence against the intervals
};

/// How much looser the second estimate matches: enough to weight the readings differently.
inline constexpr double looser_matching = 10.0;

/// Continuity for the second estimate: `looser_matching` times the sds of the set with which an estimate has ended,
/// fixed, with the same distribution; begin it from the estimate's latent states, see ShootingResidual::with().
[[nodiscard]] Continuity looser(const ShootingResidual& residual, const estimator::ActiveSet& active);

/// Defects at an estimate, with warnings.
/// @param sd  of matching, shape (n), as estimated; empty: those of the set.
[[nodiscard]] ContinuityReport matching_report(const ShootingResidual& residual, const estimator::ActiveSet& active,
                                               const Eigen::VectorXd& theta,
                                               const std::vector<Eigen::VectorXd>& latents,
                                               const Eigen::VectorXd& sd = {});

/// Adds the second estimate. Parameters without a sd (nan) have no shift.
/// @param names   of the parameters, for the warnings.
/// @param other, other_sds  of the estimate with looser(residual).
void compare(ContinuityReport& report, const ShootingResidual& residual, const estimator::ActiveSet& active,
             const std::vector<std::string>& names, const Eigen::VectorXd& theta, const Eigen::VectorXd& sds,
             const Eigen::VectorXd& other, const Eigen::VectorXd& other_sds);

}  // namespace orbid::orbits
