#pragma once

#include <string>
#include <variant>
#include <vector>

#include <Eigen/Core>

#include "estimator/interface/eigen_layout.hpp"

#pragma GCC visibility push(default)

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

/// -ln density at x with its normalisation (0 for flat). +infinity outside the support.
///
/// The support of a gamma prior is x > 0: at x = 0 its density is 0, rate or unbounded, by shape.
[[nodiscard]] double negative_log_density(const Prior& prior, double x);

/// First and second derivative of negative_log_density with respect to x (0 for flat and uniform), x in the support.
struct PriorDerivatives {
    double first;
    double second;  ///< negative in the tails of Student's t and Cauchy's density, and for gamma with shape < 1
};
[[nodiscard]] PriorDerivatives derivatives(const Prior& prior, double x);

/// Proper = integrates to one (everything but flat).
[[nodiscard]] bool is_proper(const Prior& prior);

/// The sd of the density; infinite where it does not exist: flat, half-Cauchy, Student's t with dof <= 2.
[[nodiscard]] double standard_deviation(const Prior& prior);

/// Where the density is positive, ends included or not: [0, infinity) for the priors of positive numbers.
struct Support {
    double lower;
    double upper;
};
[[nodiscard]] Support support(const Prior& prior);

/// The x below which a fraction p of the density lies, for starting points and samplers; the ends of the support at 0,
/// 1.
///
/// For priors of positive numbers never zero if p > 0, however close to zero the quantile.
/// @throws std::invalid_argument for a flat prior and for p outside [0, 1].
[[nodiscard]] double quantile(const Prior& prior, double p);

/// Throws std::invalid_argument naming the value and the rule.
void validate(const Prior& prior);

/// -ln density of a joint normal prior at x, shape (names), natural units, normalisation included.
[[nodiscard]] double negative_log_density(const JointNormalPrior& prior, const Eigen::VectorXd& x);

/// Gradient C^-1 (x - mean), shape (names), and Hessian C^-1, shape (names, names), of it.
struct JointPriorDerivatives {
    Eigen::VectorXd gradient;
    Eigen::MatrixXd hessian;
};
[[nodiscard]] JointPriorDerivatives derivatives(const JointNormalPrior& prior, const Eigen::VectorXd& x);

/// Throws std::invalid_argument naming the value and the rule: no or repeated names, shapes that do not fit the names,
/// values that are not finite. Also for a covariance that is not symmetric (to 1e-12 of the sds) or not positive
/// definite.
void validate(const JointNormalPrior& prior);

}  // namespace orbid::estimator

#pragma GCC visibility pop
