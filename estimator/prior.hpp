#pragma once

#include <string>
#include <variant>
#include <vector>

#include <Eigen/Core>

namespace orbid::estimator {

/// Densities of a parameter in its natural unit. Flat = no term in the coordinate in which steps are taken.
struct FlatPrior {};
struct NormalPrior {
    double mean;
    double sd;  ///< > 0
};
/// ln x is normal with mean ln(median) and sd `log_sd`.
struct LogNormalPrior {
    double median;  ///< > 0
    double log_sd;  ///< > 0
};
struct UniformPrior {
    double lower;
    double upper;  ///< > lower
};
/// 2 N(x; 0, scale) for x >= 0.
struct HalfNormalPrior {
    double scale;  ///< > 0
};
/// 2 / (pi scale (1 + (x / scale)^2)) for x >= 0.
struct HalfCauchyPrior {
    double scale;  ///< > 0
};
/// rate^shape x^(shape - 1) exp(-rate x) / Gamma(shape) for x > 0.
struct GammaPrior {
    double shape;  ///< > 0
    double rate;   ///< > 0
};
/// Student's t with location and scale.
struct StudentPrior {
    double dof;  ///< > 0
    double location;
    double scale;  ///< > 0
};
using Prior = std::variant<FlatPrior, NormalPrior, LogNormalPrior, UniformPrior, HalfNormalPrior, HalfCauchyPrior,
                           GammaPrior, StudentPrior>;

/// Several parameters normal together, in natural units.
struct JointNormalPrior {
    std::vector<std::string> names;
    Eigen::VectorXd mean;
    Eigen::MatrixXd covariance;  ///< symmetric positive definite
};

/// -ln density at x, up to nothing: normalisation included (0 for flat). +infinity outside the support.
[[nodiscard]] double negative_log_density(const Prior& prior, double x);

/// First and second derivative of negative_log_density with respect to x (0 for flat and uniform).
struct PriorDerivatives {
    double first;
    double second;
};
[[nodiscard]] PriorDerivatives derivatives(const Prior& prior, double x);

/// Proper = integrates to one (everything but flat). The sd of the density (infinite for flat).
[[nodiscard]] bool is_proper(const Prior& prior);
[[nodiscard]] double standard_deviation(const Prior& prior);

/// Throws std::invalid_argument naming the value and the rule.
void validate(const Prior& prior);

}  // namespace orbid::estimator
