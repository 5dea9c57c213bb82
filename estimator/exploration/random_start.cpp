#include "estimator/exploration/random_start.hpp"

#include <algorithm>
#include <cmath>
#include <type_traits>
#include <variant>

#include <boost/math/distributions/cauchy.hpp>
#include <boost/math/distributions/gamma.hpp>
#include <boost/math/distributions/normal.hpp>
#include <boost/math/distributions/students_t.hpp>

#include "estimator/interface/not_finite.hpp"
#include "estimator/problem/coordinate.hpp"
#include "models/arithmetic/cholesky_factor.hpp"

namespace orbid::estimator {

namespace {

/// Cut at both ends of what the bounds leave of a prior.
constexpr double outer_share = 0.005;

/// Quantile of a distribution truncated to the bounds, at a fraction in (0, 1) of the mass between them. nan when that
/// mass is too small for doubles (bounds far in a tail).
template <class Distribution>
double between(const Distribution& distribution, double lower, double upper, double share) {
    using boost::math::cdf;
    using boost::math::complement;
    using boost::math::quantile;
    const bool high = lower > quantile(distribution, 0.5);
    // In the upper tail the complements keep the digits.
    const auto mass = [&](double x) {
        if (x == infinity) return high ? 0.0 : 1.0;
        if (x == -infinity) return high ? 1.0 : 0.0;
        return high ? cdf(complement(distribution, x)) : cdf(distribution, x);
    };
    const double first = mass(lower);
    const double last = mass(upper);
    const double p = first + share * (last - first);
    if (!(std::abs(last - first) > 1e-290) || !(p > 0.0) || !(p < 1.0)) return nan_value;
    return high ? quantile(complement(distribution, p)) : quantile(distribution, p);
}

double prior_quantile(const Prior& prior, double lower, double upper, double share) {
    return std::visit(
        [&](const auto& p) -> double {
            using T = std::decay_t<decltype(p)>;
            using namespace boost::math;
            if constexpr (std::is_same_v<T, NormalPrior>) {
                return between(normal_distribution<double>(p.mean, p.sd), lower, upper, share);
            } else if constexpr (std::is_same_v<T, LogNormalPrior>) {
                const double from = lower > 0.0 ? std::log(lower) : -infinity;
                const double to = upper == infinity ? infinity : std::log(upper);
                return std::exp(between(normal_distribution<double>(std::log(p.median), p.log_sd), from, to, share));
            } else if constexpr (std::is_same_v<T, UniformPrior>) {
                const double from = std::max(lower, p.lower);
                return from + share * (std::min(upper, p.upper) - from);
            } else if constexpr (std::is_same_v<T, HalfNormalPrior>) {
                return between(normal_distribution<double>(0.0, p.scale), std::max(lower, 0.0), upper, share);
            } else if constexpr (std::is_same_v<T, HalfCauchyPrior>) {
                return between(cauchy_distribution<double>(0.0, p.scale), std::max(lower, 0.0), upper, share);
            } else if constexpr (std::is_same_v<T, GammaPrior>) {
                return between(gamma_distribution<double>(p.shape, 1.0 / p.rate), std::max(lower, 0.0), upper, share);
            } else if constexpr (std::is_same_v<T, StudentPrior>) {
                return p.location + p.scale * between(students_t_distribution<double>(p.dof),
                                                      (lower - p.location) / p.scale, (upper - p.location) / p.scale,
                                                      share);
            } else {
                return nan_value;  // flat
            }
        },
        prior);
}

double drawn(const FreeParameter& parameter, double width, double share) {
    if (is_proper(parameter.prior)) {
        const double inner = outer_share + (1.0 - 2.0 * outer_share) * share;
        const double x = prior_quantile(parameter.prior, parameter.lower, parameter.upper, inner);
        if (std::isfinite(x)) return x;
    }
    const Coordinate coordinate = coordinate_of(parameter);
    const double lower = coordinate.at(parameter.lower);
    const double upper = coordinate.at(parameter.upper);
    if (std::isfinite(lower) && std::isfinite(upper)) return coordinate.natural(lower + share * (upper - lower));
    if (parameter.scale == Scale::logit)  // both ends are infinite in u, the bounds themselves are finite
        return parameter.lower + share * (parameter.upper - parameter.lower);
    const double sd = width * coordinate.size(parameter.start, parameter.typical_size);
    const boost::math::normal_distribution<double> around(coordinate.at(parameter.start), sd);
    // A lower bound of zero on a log scale is -infinity in the coordinate; below zero, nan: no bound either.
    return coordinate.natural(between(around, std::isnan(lower) ? -infinity : lower, upper, share));
}

/// Bounds that are inclusive, but a log or logit coordinate never reaches its own ends; a draw on them steps inside.
double inside(const FreeParameter& parameter, double x) {
    if (!std::isfinite(x)) return parameter.start;
    x = std::clamp(x, parameter.lower, parameter.upper);
    return std::isfinite(coordinate_of(parameter).at(x)) && std::isfinite(negative_log_density(parameter.prior, x))
               ? x
               : parameter.start;
}

}  // namespace

Eigen::VectorXd random_start(const std::vector<FreeParameter>& parameters,
                             const std::vector<JointNormalPrior>& joint_priors, double width, RandomStream stream) {
    Eigen::VectorXd theta(static_cast<Eigen::Index>(parameters.size()));
    Eigen::VectorXd share(theta.size());
    for (double& value : share)
        value = stream.uniform();
    for (std::size_t i = 0; i < parameters.size(); ++i)
        theta[static_cast<Eigen::Index>(i)] = drawn(parameters[i], width, share[static_cast<Eigen::Index>(i)]);
    const boost::math::normal_distribution<double> normal;
    for (const JointNormalPrior& prior : joint_priors) {
        std::vector<Eigen::Index> member;
        for (const std::string& name : prior.names) {
            const auto found = std::find_if(parameters.begin(), parameters.end(),
                                            [&](const FreeParameter& parameter) { return parameter.name == name; });
            if (found != parameters.end()) member.push_back(found - parameters.begin());
        }
        if (member.size() != prior.names.size()) continue;  // estimate() refuses such a prior
        const models::CholeskyFactor root(prior.covariance);
        if (!root.positive_definite()) continue;  // likewise
        Eigen::VectorXd z(prior.mean.size());
        for (Eigen::Index k = 0; k < z.size(); ++k)
            z[k] = boost::math::quantile(
                normal, outer_share + (1.0 - 2.0 * outer_share) * share[member[static_cast<std::size_t>(k)]]);
        Eigen::VectorXd x = prior.mean;
        root.add_lower_times(z, x);
        for (Eigen::Index k = 0; k < z.size(); ++k)
            theta[member[static_cast<std::size_t>(k)]] = x[k];
    }
    for (std::size_t i = 0; i < parameters.size(); ++i) {
        double& value = theta[static_cast<Eigen::Index>(i)];
        value = inside(parameters[i], value);
    }
    for (std::size_t i = 0; i < parameters.size(); ++i)
        for (std::size_t k = 0; k < parameters.size(); ++k)
            if (!parameters[i].tied_to.empty() && parameters[k].name == parameters[i].tied_to)
                theta[static_cast<Eigen::Index>(i)] = parameters[i].tie_factor * theta[static_cast<Eigen::Index>(k)];
    return theta;
}

}  // namespace orbid::estimator
