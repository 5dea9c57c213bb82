#include "estimator/exploration/profile.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <stdexcept>

#include <tbb/parallel_for.h>
#include <tbb/parallel_invoke.h>
#include <tbb/partitioner.h>
#include <boost/math/distributions/chi_squared.hpp>
#include <boost/math/distributions/students_t.hpp>

#include "estimator/exploration/finished_count.hpp"
#include "estimator/exploration/profile_walk.hpp"

namespace orbid::estimator {

namespace {

void check_profile(const ProfileOptions& options) {
    const auto positive = [](const std::string& what, double value) {
        if (!(value > 0.0)) throw std::invalid_argument(what + " = " + std::to_string(value) + " must be positive");
    };
    if (!(options.level > 0.0) || !(options.level < 1.0))
        throw std::invalid_argument("level = " + std::to_string(options.level) + " must lie between 0 and 1");
    positive("tolerance", options.tolerance);
    positive("reach", options.reach);
    positive("maximum_points", options.maximum_points);
    if (options.curve_points < 0)
        throw std::invalid_argument("curve_points = " + std::to_string(options.curve_points) + " must not be negative");
}

struct Threshold {
    double value = 0.0;
    std::string method = "profile chi2";
};

/// Number of determined parameters if the scale of all records is the only error parameter, normal and flat; else 0.
double determined_with_one_scale(const Conditional& conditional, const std::vector<const Residual*>& residuals,
                                 const Estimate& estimate) {
    int scales = 0;
    std::size_t covered = 0;
    std::size_t all = 0;
    double determined = 0.0;
    for (const Unknown& other : conditional.unknowns()) {
        if (other.parameter >= 0 && std::isfinite(other.sd)) determined += 1.0;
        if (other.parameter >= 0) continue;
        if (other.error != "scale") return 0.0;
        ++scales;
    }
    for (const Residual* residual : residuals) {
        if (!residual->covariances().empty()) return 0.0;
        for (const Group& group : residual->groups())
            if (group.scale.estimate &&
                (is_proper(group.scale.prior) || !std::holds_alternative<NormalErrors>(group.distribution)))
                return 0.0;
    }
    for (const EstimatedScale& scale : estimate.scales) {
        all += scale.count;
        if (scale.estimated) covered += scale.count;
    }
    return scales == 1 && covered == all && estimate.degrees_of_freedom > 0.0 ? determined : 0.0;
}

/// See profiles(). Degrees of freedom are the estimate's own.
Threshold threshold_of(const Conditional& conditional, const Unknown& unknown,
                       const std::vector<const Residual*>& residuals, const Estimate& estimate, double level) {
    using Student = boost::math::students_t_distribution<double>;
    const double upper = 0.5 + 0.5 * level;
    const double determined = determined_with_one_scale(conditional, residuals, estimate);
    const bool one_scale = determined > 0.0 && unknown.parameter >= 0;
    const double dof = estimate.degrees_of_freedom;
    Threshold result;
    double quantile = std::sqrt(boost::math::quantile(boost::math::chi_squared_distribution<double>(1.0), level));
    if (std::isfinite(unknown.degrees_of_freedom)) {
        quantile = boost::math::quantile(Student(unknown.degrees_of_freedom), upper);
        result.method = "profile sandwich";
    } else if (one_scale) {
        quantile = boost::math::quantile(Student(dof), upper);
        result.method = "profile t";
    }
    const double square = std::pow(unknown.widening * quantile, 2);
    // The scale takes part of the deviance: what is t^2 at the estimate's scale is less where it follows.
    result.value = one_scale ? (dof + determined) * std::log1p(square / dof) : square;
    return result;
}

/// The minimum of the profile itself, from which restricted error parameters differ a little; none: it says why.
std::optional<ProfileNode> minimum_of(const Conditional& conditional, const Unknown& unknown, Profile& profile) {
    const ConditionalEstimate best = conditional.free(Variance::ml, false);
    profile.evaluations = best.evaluations;
    if (!best.good()) {
        profile.lower_end = profile.upper_end =
            best.status == EstimateStatus::interrupted ? ProfileEnd::interrupted : ProfileEnd::failed;
        profile.message = "the estimate by maximum likelihood: " + best.message;
        return std::nullopt;
    }
    // At that minimum the unknown is held where it is: its objective is that of every other point.
    double value = unknown.value;
    if (unknown.parameter >= 0) value = best.at.theta[unknown.parameter];
    for (const auto& [error, found] : best.at.errors)
        if (unknown.parameter < 0 && error == unknown.name) value = found;
    const double u = std::clamp(conditional.coordinate(unknown, value), unknown.lower, unknown.upper);
    const ConditionalEstimate held = conditional.at(unknown, u, best.at, Variance::ml, false);
    profile.evaluations += held.evaluations;
    const double prior = conditional.log_prior(unknown, u);
    if (!held.good() || !std::isfinite(prior)) {
        profile.lower_end = profile.upper_end = ProfileEnd::failed;
        profile.message = "the others do not converge with it held at its estimate: " + held.message;
        return std::nullopt;
    }
    return ProfileNode{u, held.objective - prior, 0.0, held.at};
}

/// Interval and points from both sides.
void join_sides(const Conditional& conditional, const Unknown& unknown, const ProfileSide& down, const ProfileSide& up,
                Profile& profile) {
    profile.lower_end = down.end;
    profile.upper_end = up.end;
    const auto end_of = [&](const ProfileSide& side, double open) {
        return side.end == ProfileEnd::open && !std::isfinite(side.limit) ? open
                                                                          : conditional.natural(unknown, side.limit);
    };
    profile.lower = end_of(down, unknown.natural_lower);
    profile.upper = end_of(up, unknown.natural_upper);
    const double centre = up.nodes.front().objective;
    double least = centre;
    const auto add = [&](const ProfileNode& node, int sign) {
        least = std::min(least, node.objective);
        profile.points.push_back({node.u, conditional.natural(unknown, node.u), node.objective, sign * node.root,
                                  conditional.expand(node.at.theta)});
    };
    for (std::size_t k = down.nodes.size(); k-- > 1;)
        add(down.nodes[k], -1);
    for (const ProfileNode& node : up.nodes)
        add(node, 1);
    profile.failed = down.failed;
    profile.failed.insert(profile.failed.end(), up.failed.begin(), up.failed.end());
    std::sort(profile.failed.begin(), profile.failed.end());
    profile.evaluations += down.evaluations + up.evaluations;
    // Rounding of an objective that is a sum over many records stays far below this.
    if (centre - least > 1e-6) {
        profile.improvement = centre - least;
        profile.message = "a lower minimum than the estimate's was met on the way";
    }
    profile.known = down.end != ProfileEnd::interrupted && up.end != ProfileEnd::interrupted;
}

Profile profile_of(const Conditional& conditional, const Unknown& unknown, const EstimateOptions& estimate,
                   const ProfileOptions& options, const Threshold& threshold) {
    Profile result;
    result.name = unknown.name;
    result.unit = unknown.unit;
    result.value = unknown.value;
    result.threshold = threshold.value;
    result.method = threshold.method;
    result.lower = result.upper = nan_value;
    if (!std::isfinite(unknown.u)) {
        result.message = "the estimate is at an end that its scale never reaches";
        return result;
    }
    if (unknown.too_few_independent) {
        result.lower_end = result.upper_end = ProfileEnd::open;
        result.message = "the residuals hold too few independent values for an interval";
        return result;
    }
    const std::optional<ProfileNode> centre = minimum_of(conditional, unknown, result);
    if (!centre) return result;
    ProfileOptions adjusted = options;
    adjusted.reach *= std::max(1.0, unknown.widening);
    ProfileWalk down(conditional, unknown, estimate, adjusted, *centre, threshold.value, -1);
    ProfileWalk up(conditional, unknown, estimate, adjusted, *centre, threshold.value, 1);
    const auto go = [](ProfileWalk& walk) {
        walk.find_end();
        walk.draw_curve();
    };
    tbb::parallel_invoke([&] { go(down); }, [&] { go(up); });
    result.value = conditional.natural(unknown, centre->u);
    join_sides(conditional, unknown, down.side, up.side, result);
    return result;
}

}  // namespace

std::string_view name(ProfileEnd end) {
    constexpr std::array names{"found", "bound", "open", "failed", "interrupted"};
    return names[static_cast<std::size_t>(end)];
}

std::vector<Profile> profiles(const std::vector<FreeParameter>& parameters,
                              const std::vector<const Residual*>& residuals, const EstimateOptions& options,
                              const Estimate& estimate, const ProfileOptions& profile) {
    check_profile(profile);
    const Conditional conditional(parameters, residuals, options, estimate);
    const std::vector<Unknown> which = conditional.named(profile.names);
    std::vector<Profile> result(which.size());
    FinishedCount finished(profile.progress, which.size());
    tbb::parallel_for(
        std::size_t{0}, which.size(),
        [&](std::size_t k) {
            result[k] = profile_of(conditional, which[k], options, profile,
                                   threshold_of(conditional, which[k], residuals, estimate, profile.level));
            finished.add();
        },
        tbb::simple_partitioner{});
    return result;
}

}  // namespace orbid::estimator
