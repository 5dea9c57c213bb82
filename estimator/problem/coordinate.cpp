#include "estimator/problem/coordinate.hpp"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <limits>
#include <numbers>

#include <boost/math/special_functions/gamma.hpp>
#include <boost/math/special_functions/trigamma.hpp>

#include "estimator/interface/not_finite.hpp"
#include "models/arithmetic/eigenvalues.hpp"

namespace orbid::estimator {

namespace {

/// Distance of the quartiles of a normal density of sd 1.
constexpr double normal_quartiles = 1.3489795003921634;

/// x(u) to second order, and J = ln |dx/du| with its derivatives.
struct Transform {
    double x;
    double first;   ///< dx/du
    double second;  ///< d^2x/du^2
    double jacobian;
    double jacobian_first;
    double jacobian_second;
};

Transform transform(const Coordinate& coordinate, double u) {
    const double x = coordinate.natural(u);
    if (coordinate.scale == Scale::linear) return {x, 1.0, 0.0, 0.0, 0.0, 0.0};
    if (coordinate.scale == Scale::log) return {x, x, x, u, 1.0, 0.0};
    if (coordinate.scale == Scale::log10) {
        constexpr double k = std::numbers::ln10;
        return {x, x * k, x * k * k, u * k + std::log(k), k, 0.0};
    }
    const double width = coordinate.upper - coordinate.lower;
    const double below = logistic(u);
    const double above = logistic(-u);
    const double first = width * below * above;
    // ln(s (1 - s)) = -|u| - 2 ln(1 + exp(-|u|)), finite at every u.
    const double jacobian = std::log(width) - std::abs(u) - 2.0 * std::log1p(std::exp(-std::abs(u)));
    return {x, first, first * (above - below), jacobian, above - below, -2.0 * below * above};
}

/// -ln of the density of v = ln x and its derivatives, for priors that are best written in v.
struct LogDensity {
    bool known = false;
    double value = 0.0;
    double first = 0.0;
    double second = 0.0;
};

LogDensity log_density(const Prior& prior, double v) {
    if (const auto* p = std::get_if<LogNormalPrior>(&prior)) {
        const double standard = (v - std::log(p->median)) / p->log_sd;
        const double normalisation = std::log(p->log_sd) + 0.5 * std::log(2.0 * std::numbers::pi);
        return {true, 0.5 * standard * standard + normalisation, standard / p->log_sd, 1.0 / (p->log_sd * p->log_sd)};
    }
    if (const auto* p = std::get_if<GammaPrior>(&prior)) {
        const double scaled = std::exp(v + std::log(p->rate));
        return {true, scaled - p->shape * (v + std::log(p->rate)) + boost::math::lgamma(p->shape), scaled - p->shape,
                scaled};
    }
    return {};
}

/// The part of d^2(-ln p)/dx^2 that is positive whatever x: what Gauss-Newton would make of the density.
double positive_part(const Prior& prior, double x) {
    if (const auto* p = std::get_if<NormalPrior>(&prior)) return 1.0 / (p->sd * p->sd);
    if (const auto* p = std::get_if<HalfNormalPrior>(&prior)) return 1.0 / (p->scale * p->scale);
    if (const auto* p = std::get_if<LogNormalPrior>(&prior)) return 1.0 / (x * x * p->log_sd * p->log_sd);
    if (const auto* p = std::get_if<HalfCauchyPrior>(&prior)) return 2.0 / (p->scale * p->scale + x * x);
    if (const auto* p = std::get_if<StudentPrior>(&prior)) {
        const double distance = x - p->location;
        return (p->dof + 1.0) / (p->dof * p->scale * p->scale + distance * distance);
    }
    if (const auto* p = std::get_if<GammaPrior>(&prior)) return std::max(p->shape - 1.0, 0.0) / (x * x);
    return 0.0;
}

/// sd of ln x where it does not depend on where one looks; nan for other priors.
double log_sd(const Prior& prior) {
    if (const auto* p = std::get_if<LogNormalPrior>(&prior)) return p->log_sd;
    if (const auto* p = std::get_if<GammaPrior>(&prior)) return std::sqrt(boost::math::trigamma(p->shape));
    // ln of the absolute value of a standard normal and of a standard Cauchy number.
    if (std::holds_alternative<HalfNormalPrior>(prior)) return std::numbers::pi / std::sqrt(8.0);
    if (std::holds_alternative<HalfCauchyPrior>(prior)) return 0.5 * std::numbers::pi;
    return std::numeric_limits<double>::quiet_NaN();
}

/// A value on a logarithmic scale is positive, however far a step goes: only at u = -infinity it is 0.
double positive(double value, double u) {
    return std::isfinite(u) ? std::max(value, std::numeric_limits<double>::min()) : value;
}

}  // namespace

double Coordinate::at(double natural) const {
    if (scale == Scale::log) return std::log(natural);
    if (scale == Scale::log10) return std::log10(natural);
    if (scale == Scale::logit) return std::log(natural - lower) - std::log(upper - natural);
    return natural;
}

double Coordinate::natural(double u) const {
    if (scale == Scale::log) return positive(std::exp(u), u);
    if (scale == Scale::log10) return positive(std::pow(10.0, u), u);
    if (scale == Scale::linear) return u;
    // From the nearer bound, and never beyond it by rounding.
    const double x = u <= 0.0 ? lower + (upper - lower) * logistic(u) : upper - (upper - lower) * logistic(-u);
    return std::clamp(x, lower, upper);
}

double Coordinate::slope(double natural) const {
    if (scale == Scale::log) return natural;
    if (scale == Scale::log10) return natural * std::numbers::ln10;
    if (scale == Scale::logit) return (natural - lower) * ((upper - natural) / (upper - lower));
    return 1.0;
}

PriorTerm Coordinate::term(const Prior& prior, double u) const {
    if (!is_proper(prior)) return {};
    const bool logarithmic = scale == Scale::log || scale == Scale::log10;
    if (logarithmic) {
        // Written in ln x itself, so that nothing cancels and x may underflow.
        const double k = scale == Scale::log10 ? std::numbers::ln10 : 1.0;
        const LogDensity density = log_density(prior, k * u);
        if (density.known) {
            if (!std::isfinite(density.value)) return {infinity, 0.0, 0.0, 0.0};
            const double second = k * k * density.second;
            return {density.value - std::log(k), k * density.first, second, second};
        }
    }
    const Transform t = transform(*this, u);
    const double value = negative_log_density(prior, t.x) - t.jacobian;
    if (!std::isfinite(value)) return {infinity, 0.0, 0.0, 0.0};
    const PriorDerivatives natural_terms = derivatives(prior, t.x);
    PriorTerm term;
    term.value = value;
    term.gradient = natural_terms.first * t.first - t.jacobian_first;
    term.second = natural_terms.second * t.first * t.first + natural_terms.first * t.second - t.jacobian_second;
    // -J'' is never negative.
    term.curvature =
        term.second > 0.0 ? term.second : positive_part(prior, t.x) * t.first * t.first - t.jacobian_second;
    if (!(term.curvature >= 0.0) || !std::isfinite(term.curvature)) term.curvature = 0.0;
    return term;
}

double Coordinate::prior_sd(const Prior& prior, double natural) const {
    if (!is_proper(prior)) return infinity;
    const bool logarithmic = scale == Scale::log || scale == Scale::log10;
    const double in_log = log_sd(prior);
    if (std::holds_alternative<LogNormalPrior>(prior) || (logarithmic && !std::isnan(in_log)))
        return scale == Scale::linear ? in_log * std::abs(natural) : in_log * std::abs(natural / slope(natural));
    double sd = standard_deviation(prior);
    if (!std::isfinite(sd)) sd = (quantile(prior, 0.75) - quantile(prior, 0.25)) / normal_quartiles;
    return sd / std::abs(slope(natural));
}

double Coordinate::size(double natural, double typical) const {
    if (scale == Scale::log) return 1.0;
    if (scale == Scale::log10) return 1.0 / std::numbers::ln10;
    return std::max(std::abs(natural), typical) / std::abs(slope(natural));
}

double logistic(double u) {
    return u >= 0.0 ? 1.0 / (1.0 + std::exp(-u)) : std::exp(u) / (1.0 + std::exp(u));
}

Coordinate coordinate_of(const FreeParameter& parameter) {
    if (parameter.scale == Scale::logit) return {parameter.scale, parameter.lower, parameter.upper};
    return {parameter.scale};
}

JointPriorTerm joint_term(const JointNormalPrior& prior, const std::vector<Coordinate>& coordinates,
                          const Eigen::VectorXd& u) {
    const Eigen::Index count = u.size();
    assert(static_cast<Eigen::Index>(coordinates.size()) == count && prior.mean.size() == count);
    Eigen::VectorXd x(count);
    Eigen::VectorXd first(count);
    Eigen::VectorXd second(count);
    JointPriorTerm term;
    Eigen::VectorXd jacobian_first(count);
    Eigen::VectorXd jacobian_second(count);
    for (Eigen::Index i = 0; i < count; ++i) {
        const Transform t = transform(coordinates[static_cast<std::size_t>(i)], u[i]);
        x[i] = t.x;
        first[i] = t.first;
        second[i] = t.second;
        jacobian_first[i] = t.jacobian_first;
        jacobian_second[i] = t.jacobian_second;
        term.value -= t.jacobian;
    }
    term.value += negative_log_density(prior, x);
    const JointPriorDerivatives natural_terms = derivatives(prior, x);
    term.gradient = natural_terms.gradient.cwiseProduct(first) - jacobian_first;
    const Eigen::MatrixXd gauss_newton = first.asDiagonal() * natural_terms.hessian * first.asDiagonal();
    const Eigen::VectorXd bent = natural_terms.gradient.cwiseProduct(second) - jacobian_second;
    term.second = gauss_newton;
    term.second.diagonal() += bent;
    term.curvature = term.second;
    if (!(models::symmetric_eigenvalues(term.second).minCoeff() > 0.0)) {
        term.curvature = gauss_newton;
        term.curvature.diagonal() += bent.cwiseMax(0.0);
    }
    return term;
}

}  // namespace orbid::estimator
