#include "estimator/interface/prior.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <sstream>
#include <stdexcept>
#include <string>

#include <boost/math/distributions/students_t.hpp>
#include <boost/math/special_functions/erf.hpp>
#include <boost/math/special_functions/gamma.hpp>

#include "estimator/interface/not_finite.hpp"

namespace orbid::estimator {

namespace {

/// ln sqrt(2 pi), the normalisation of the normal density.
const double ln_sqrt_two_pi = 0.5 * std::log(2.0 * std::numbers::pi);

[[noreturn]] void refuse_value(const std::string& what, double value, const std::string& rule) {
    std::ostringstream text;
    text.precision(17);
    text << what << " = " << value << ": " << rule;
    throw std::invalid_argument(text.str());
}

void check_finite(const std::string& what, double value) {
    if (!std::isfinite(value)) refuse_value(what, value, "must be finite");
}

void check_positive(const std::string& what, double value) {
    if (!(value > 0.0) || !std::isfinite(value)) refuse_value(what, value, "must be positive and finite");
}

/// ln(1 + t^2 / n) without overflow of t^2.
double ln_one_plus_square(double t, double n) {
    // Beyond 1e100 the one is far below rounding.
    return std::abs(t) < 1e100 ? std::log1p(t * t / n) : 2.0 * std::log(std::abs(t)) - std::log(n);
}

/// First and second derivative of (n + 1) / 2 ln(1 + t^2 / n) with respect to t, without overflow of t^2.
PriorDerivatives student_derivatives(double t, double n) {
    // t / (n + t^2), written so that neither a small nor a large t overflows.
    const double ratio = std::abs(t) < 1.0 ? t / (n + t * t) : 1.0 / (n / t + t);
    return {(n + 1.0) * ratio, (n + 1.0) * (1.0 - 2.0 * t * ratio) / (n + t * t)};
}

template <class... Cases>
struct Overloaded : Cases... {
    using Cases::operator()...;
};
template <class... Cases>
Overloaded(Cases...) -> Overloaded<Cases...>;

}  // namespace

double negative_log_density(const Prior& prior, double x) {
    return std::visit(
        Overloaded{[](const FlatPrior&) { return 0.0; },
                   [x](const NormalPrior& p) {
                       const double standard = (x - p.mean) / p.sd;
                       return 0.5 * standard * standard + std::log(p.sd) + ln_sqrt_two_pi;
                   },
                   [x](const LogNormalPrior& p) {
                       if (!(x > 0.0)) return infinity;
                       const double standard = std::log(x / p.median) / p.log_sd;
                       return 0.5 * standard * standard + std::log(p.log_sd) + std::log(x) + ln_sqrt_two_pi;
                   },
                   [x](const UniformPrior& p) {
                       return x >= p.lower && x <= p.upper ? std::log(p.upper - p.lower) : infinity;
                   },
                   [x](const HalfNormalPrior& p) {
                       if (!(x >= 0.0)) return infinity;
                       const double standard = x / p.scale;
                       return 0.5 * standard * standard + std::log(p.scale) + ln_sqrt_two_pi - std::numbers::ln2;
                   },
                   [x](const HalfCauchyPrior& p) {
                       if (!(x >= 0.0)) return infinity;
                       return ln_one_plus_square(x / p.scale, 1.0) + std::log(p.scale) +
                              std::log(0.5 * std::numbers::pi);
                   },
                   [x](const GammaPrior& p) {
                       if (!(x > 0.0)) return infinity;
                       return p.rate * x - (p.shape - 1.0) * std::log(x) - p.shape * std::log(p.rate) +
                              boost::math::lgamma(p.shape);
                   },
                   [x](const StudentPrior& p) {
                       // Gamma(dof / 2) / Gamma((dof + 1) / 2) as one ratio: the logarithms would cancel at large dof.
                       return 0.5 * (p.dof + 1.0) * ln_one_plus_square((x - p.location) / p.scale, p.dof) +
                              std::log(p.scale) + 0.5 * std::log(p.dof * std::numbers::pi) +
                              std::log(boost::math::tgamma_delta_ratio(0.5 * p.dof, 0.5));
                   }},
        prior);
}

PriorDerivatives derivatives(const Prior& prior, double x) {
    return std::visit(
        Overloaded{[](const auto&) {  // flat and uniform
                       return PriorDerivatives{0.0, 0.0};
                   },
                   [x](const NormalPrior& p) {
                       return PriorDerivatives{(x - p.mean) / (p.sd * p.sd), 1.0 / (p.sd * p.sd)};
                   },
                   [x](const LogNormalPrior& p) {
                       const double variance = p.log_sd * p.log_sd;
                       const double standard = std::log(x / p.median) / variance;
                       return PriorDerivatives{(standard + 1.0) / x, (1.0 / variance - standard - 1.0) / (x * x)};
                   },
                   [x](const HalfNormalPrior& p) {
                       return PriorDerivatives{x / (p.scale * p.scale), 1.0 / (p.scale * p.scale)};
                   },
                   [x](const HalfCauchyPrior& p) {
                       const PriorDerivatives d = student_derivatives(x / p.scale, 1.0);
                       return PriorDerivatives{d.first / p.scale, d.second / (p.scale * p.scale)};
                   },
                   [x](const GammaPrior& p) {
                       return PriorDerivatives{p.rate - (p.shape - 1.0) / x, (p.shape - 1.0) / (x * x)};
                   },
                   [x](const StudentPrior& p) {
                       const PriorDerivatives d = student_derivatives((x - p.location) / p.scale, p.dof);
                       return PriorDerivatives{d.first / p.scale, d.second / (p.scale * p.scale)};
                   }},
        prior);
}

bool is_proper(const Prior& prior) {
    return !std::holds_alternative<FlatPrior>(prior);
}

double standard_deviation(const Prior& prior) {
    return std::visit(
        Overloaded{
            [](const auto&) { return infinity; }, [](const NormalPrior& p) { return p.sd; },
            [](const LogNormalPrior& p) {
                const double variance = p.log_sd * p.log_sd;
                return p.median * std::exp(0.5 * variance) * std::sqrt(std::expm1(variance));
            },
            [](const UniformPrior& p) { return (p.upper - p.lower) / std::sqrt(12.0); },
            [](const HalfNormalPrior& p) { return p.scale * std::sqrt(1.0 - 2.0 / std::numbers::pi); },
            [](const GammaPrior& p) { return std::sqrt(p.shape) / p.rate; },
            [](const StudentPrior& p) { return p.dof > 2.0 ? p.scale * std::sqrt(p.dof / (p.dof - 2.0)) : infinity; }},
        prior);
}

Support support(const Prior& prior) {
    if (const auto* uniform = std::get_if<UniformPrior>(&prior)) return {uniform->lower, uniform->upper};
    const bool positive = std::holds_alternative<LogNormalPrior>(prior) ||
                          std::holds_alternative<HalfNormalPrior>(prior) ||
                          std::holds_alternative<HalfCauchyPrior>(prior) || std::holds_alternative<GammaPrior>(prior);
    return {positive ? 0.0 : -infinity, infinity};
}

double quantile(const Prior& prior, double p) {
    if (!is_proper(prior)) refuse_value("quantile of a flat prior at p", p, "a flat prior has none");
    if (!(p >= 0.0) || !(p <= 1.0)) refuse_value("p of a quantile", p, "must lie in [0, 1]");
    const Support ends = support(prior);
    if (p == 0.0) return ends.lower;
    if (p == 1.0) return ends.upper;
    // From the nearer tail, so that p close to one costs no digits.
    const auto normal = [p] { return -std::numbers::sqrt2 * boost::math::erfc_inv(2.0 * p); };
    const auto positive = [](double x) { return std::max(x, std::numeric_limits<double>::min()); };
    return std::visit(
        Overloaded{
            [](const FlatPrior&) { return 0.0; },  // refused above
            [&](const NormalPrior& q) { return q.mean + q.sd * normal(); },
            [&](const LogNormalPrior& q) { return positive(q.median * std::exp(q.log_sd * normal())); },
            [&](const UniformPrior& q) { return std::clamp(q.lower + p * (q.upper - q.lower), q.lower, q.upper); },
            [&](const HalfNormalPrior& q) { return positive(q.scale * std::numbers::sqrt2 * boost::math::erf_inv(p)); },
            [&](const HalfCauchyPrior& q) {
                const double half_pi = 0.5 * std::numbers::pi;
                return positive(q.scale * (p < 0.5 ? std::tan(half_pi * p) : 1.0 / std::tan(half_pi * (1.0 - p))));
            },
            [&](const GammaPrior& q) { return positive(boost::math::gamma_p_inv(q.shape, p) / q.rate); },
            [&](const StudentPrior& q) {
                return q.location + q.scale * boost::math::quantile(boost::math::students_t(q.dof), p);
            }},
        prior);
}

void validate(const Prior& prior) {
    std::visit(Overloaded{[](const FlatPrior&) {},
                          [](const NormalPrior& p) {
                              check_finite("mean of the normal prior", p.mean);
                              check_positive("sd of the normal prior", p.sd);
                          },
                          [](const LogNormalPrior& p) {
                              check_positive("median of the log-normal prior", p.median);
                              check_positive("log_sd of the log-normal prior", p.log_sd);
                          },
                          [](const UniformPrior& p) {
                              check_finite("lower end of the uniform prior", p.lower);
                              check_finite("upper end of the uniform prior", p.upper);
                              if (!(p.upper > p.lower))
                                  refuse_value("upper end of the uniform prior", p.upper,
                                               "must be above the lower end " + std::to_string(p.lower));
                          },
                          [](const HalfNormalPrior& p) { check_positive("scale of the half-normal prior", p.scale); },
                          [](const HalfCauchyPrior& p) { check_positive("scale of the half-Cauchy prior", p.scale); },
                          [](const GammaPrior& p) {
                              check_positive("shape of the gamma prior", p.shape);
                              check_positive("rate of the gamma prior", p.rate);
                          },
                          [](const StudentPrior& p) {
                              check_positive("dof of the Student prior", p.dof);
                              check_finite("location of the Student prior", p.location);
                              check_positive("scale of the Student prior", p.scale);
                          }},
               prior);
}

}  // namespace orbid::estimator
