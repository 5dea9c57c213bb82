#include "estimator/prior.hpp"

#include <cmath>
#include <numbers>
#include <stdexcept>
#include <string>

namespace orbid::estimator {

namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();
/// ln sqrt(2 pi), the normalisation of the normal density.
const double ln_sqrt_two_pi = 0.5 * std::log(2.0 * std::numbers::pi);

void refuse(const std::string& what, double value, const std::string& rule) {
    throw std::invalid_argument(what + " = " + std::to_string(value) + ": " + rule);
}

template <class... Cases>
struct Overloaded : Cases... {
    using Cases::operator()...;
};
template <class... Cases>
Overloaded(Cases...) -> Overloaded<Cases...>;

}  // namespace

double negative_log_density(const Prior& prior, double x) {
    return std::visit(Overloaded{[](const FlatPrior&) { return 0.0; },
                                 [x](const NormalPrior& p) {
                                     const double standard = (x - p.mean) / p.sd;
                                     return 0.5 * standard * standard + std::log(p.sd) + ln_sqrt_two_pi;
                                 },
                                 [x](const LogNormalPrior& p) {
                                     if (!(x > 0.0)) return infinity;
                                     const double standard = std::log(x / p.median) / p.log_sd;
                                     return 0.5 * standard * standard + std::log(p.log_sd) + std::log(x) +
                                            ln_sqrt_two_pi;
                                 },
                                 [x](const UniformPrior& p) {
                                     return x >= p.lower && x <= p.upper ? std::log(p.upper - p.lower) : infinity;
                                 }},
                      prior);
}

PriorDerivatives derivatives(const Prior& prior, double x) {
    return std::visit(
        Overloaded{[](const FlatPrior&) {
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
                   [](const UniformPrior&) {
                       return PriorDerivatives{0.0, 0.0};
                   }},
        prior);
}

bool is_proper(const Prior& prior) {
    return !std::holds_alternative<FlatPrior>(prior);
}

double standard_deviation(const Prior& prior) {
    return std::visit(Overloaded{[](const FlatPrior&) { return infinity; }, [](const NormalPrior& p) { return p.sd; },
                                 [](const LogNormalPrior& p) {
                                     const double variance = p.log_sd * p.log_sd;
                                     return p.median * std::exp(0.5 * variance) * std::sqrt(std::expm1(variance));
                                 },
                                 [](const UniformPrior& p) { return (p.upper - p.lower) / std::sqrt(12.0); }},
                      prior);
}

void validate(const Prior& prior) {
    std::visit(Overloaded{[](const FlatPrior&) {},
                          [](const NormalPrior& p) {
                              if (!std::isfinite(p.mean)) refuse("mean of the normal prior", p.mean, "must be finite");
                              if (!(p.sd > 0.0) || !std::isfinite(p.sd))
                                  refuse("sd of the normal prior", p.sd, "must be positive and finite");
                          },
                          [](const LogNormalPrior& p) {
                              if (!(p.median > 0.0) || !std::isfinite(p.median))
                                  refuse("median of the log-normal prior", p.median, "must be positive and finite");
                              if (!(p.log_sd > 0.0) || !std::isfinite(p.log_sd))
                                  refuse("log_sd of the log-normal prior", p.log_sd, "must be positive and finite");
                          },
                          [](const UniformPrior& p) {
                              if (!std::isfinite(p.lower))
                                  refuse("lower end of the uniform prior", p.lower, "must be finite");
                              if (!(p.upper > p.lower) || !std::isfinite(p.upper))
                                  refuse("upper end of the uniform prior", p.upper,
                                         "must be finite and above the lower end " + std::to_string(p.lower));
                          }},
               prior);
}

}  // namespace orbid::estimator
