#include "orbits/series_residuals/continuity_report.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include <fmt/format.h>

namespace orbid::orbits {

using Eigen::Index;
using Eigen::VectorXd;

namespace {

/// Chance that the error of one coordinate exceeds three sds (scales): of the normal distribution, and of Student's t
/// with 4 degrees of freedom; other degrees lie between.
constexpr double normal_beyond = 0.0027;
constexpr double student_beyond = 0.0399;

constexpr double far_shift = 3.0;

}  // namespace

Continuity looser(const ShootingResidual& residual, const estimator::ActiveSet& active) {
    Continuity matching = residual.matching();
    matching.kind = matching.kind == Continuity::Kind::normal ? Continuity::Kind::normal : Continuity::Kind::student_t;
    matching.sd = looser_matching * residual.matching_sd(active);
    matching.estimate = false;
    matching.constraints = false;
    return matching;
}

ContinuityReport matching_report(const ShootingResidual& residual, const estimator::ActiveSet& active,
                                 const VectorXd& theta, const std::vector<VectorXd>& latents, const VectorXd& sd) {
    ContinuityReport report;
    report.sd = sd.size() > 0 ? sd : residual.matching_sd(active);
    report.noise = residual.noise(active);
    report.defect = residual.defect(active, theta, latents, report.sd);
    const Continuity::Kind kind = residual.matching().kind;
    const auto n = static_cast<double>(report.sd.size());
    if (kind != Continuity::Kind::exact)
        report.expected = std::min(1.0, n * (kind == Continuity::Kind::student_t ? student_beyond : normal_beyond));
    const auto count = static_cast<double>(report.defect.count);
    // Three times what is expected, and three by chance.
    const double allowed = 3.0 + 3.0 * report.expected * count;
    const auto large = static_cast<double>(report.defect.large);
    if (!residual.matching().constraints && large > allowed)
        report.warnings.push_back(fmt::format(
            "{} of {} intervals do not meet the next within three sds of the matching ({:.1f} expected): the "
            "model does not follow the record there, and intervals are too short",
            report.defect.large, report.defect.count, report.expected * count));
    const bool sampled = residual.series().sampling == Series::Sampling::samples;
    if (kind == Continuity::Kind::exact && !sampled && report.noise > folding_readings)
        report.warnings.push_back(fmt::format(
            "readings err by {:.2g} % of the range: the posterior over the trajectory folds, and intervals may "
            "be too short",
            100.0 * report.noise));
    return report;
}

void compare(ContinuityReport& report, const ShootingResidual& residual, const estimator::ActiveSet& active,
             const std::vector<std::string>& names, const VectorXd& theta, const VectorXd& sds, const VectorXd& other,
             const VectorXd& other_sds) {
    report.looser = looser_matching * residual.matching_sd(active);
    report.shift = VectorXd::Constant(theta.size(), std::numeric_limits<double>::quiet_NaN());
    for (Index i = 0; i < theta.size(); ++i) {
        // Both variances are estimates: of nearly equal ones the difference says little.
        constexpr double least_share = 0.05;
        const double own = sds[i] * sds[i];
        const double less = other_sds[i] * other_sds[i];
        const double variance = std::max(less - own, least_share * std::max(less, own));
        if (!(variance > 0.0)) continue;
        report.shift[i] = (theta[i] - other[i]) / std::sqrt(variance);
        if (std::abs(report.shift[i]) > far_shift)
            report.warnings.push_back(fmt::format(
                "{} moves by {:.1f} sds when matching is {:.0f} times looser: the model does not say the same at all "
                "times, or the estimate is in a false minimum",
                names[static_cast<std::size_t>(i)], report.shift[i], looser_matching));
    }
}

}  // namespace orbid::orbits
