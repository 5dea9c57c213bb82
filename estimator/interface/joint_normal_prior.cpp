#include <cmath>
#include <numbers>
#include <set>
#include <stdexcept>
#include <string>

#include <fmt/format.h>

#include "estimator/interface/prior.hpp"
#include "models/arithmetic/cholesky_factor.hpp"

namespace orbid::estimator {

namespace {

/// Relative to the two sds of an element: more asymmetry than the rounding of printed digits is a mistake.
constexpr double symmetry_tolerance = 1e-12;
/// 2 ln sqrt(2 pi), the normalisation of the normal density per dimension.
const double ln_two_pi = std::log(2.0 * std::numbers::pi);

[[noreturn]] void refuse_joint_prior(const std::string& what) {
    throw std::invalid_argument("joint normal prior: " + what);
}

/// Cholesky factor of the correlation matrix: parameters of very different sizes are well conditioned at unit sds.
struct Factor {
    Eigen::VectorXd sd;
    models::CholeskyFactor correlation;
};

Factor factorise(const Eigen::MatrixXd& covariance) {
    const Eigen::VectorXd sd = covariance.diagonal().cwiseSqrt();
    const Eigen::VectorXd precision_root = sd.cwiseInverse();
    return {sd, models::CholeskyFactor(precision_root.asDiagonal() * covariance * precision_root.asDiagonal())};
}

}  // namespace

double negative_log_density(const JointNormalPrior& prior, const Eigen::VectorXd& x) {
    const Factor factor = factorise(prior.covariance);
    Eigen::VectorXd standard = (x - prior.mean).cwiseQuotient(factor.sd);
    factor.correlation.solve_lower_in_place(standard);
    const Eigen::MatrixXd& lower = factor.correlation.lower();
    const double ln_determinant = factor.sd.array().log().sum() + lower.diagonal().array().log().sum();
    return 0.5 * standard.squaredNorm() + ln_determinant + 0.5 * ln_two_pi * static_cast<double>(x.size());
}

JointPriorDerivatives derivatives(const JointNormalPrior& prior, const Eigen::VectorXd& x) {
    const Factor factor = factorise(prior.covariance);
    Eigen::MatrixXd root = factor.sd.cwiseInverse().asDiagonal();
    factor.correlation.solve_lower_in_place(root);
    JointPriorDerivatives result;
    const Eigen::MatrixXd precision = root.transpose() * root;
    result.gradient = root.transpose() * (root * (x - prior.mean));
    result.hessian = precision.selfadjointView<Eigen::Lower>();
    return result;
}

void validate(const JointNormalPrior& prior) {
    const auto count = static_cast<Eigen::Index>(prior.names.size());
    if (count == 0) refuse_joint_prior("names: needs at least one");
    std::set<std::string> names;
    for (const std::string& name : prior.names)
        if (!names.insert(name).second) refuse_joint_prior("\"" + name + "\" is named twice");
    if (prior.mean.size() != count)
        refuse_joint_prior("mean has " + std::to_string(prior.mean.size()) + " values for " + std::to_string(count) +
                           " names");
    if (prior.covariance.rows() != count || prior.covariance.cols() != count)
        refuse_joint_prior("covariance is " + std::to_string(prior.covariance.rows()) + " x " +
                           std::to_string(prior.covariance.cols()) + ", must be " + std::to_string(count) + " x " +
                           std::to_string(count));
    for (Eigen::Index i = 0; i < count; ++i) {
        const std::string& name = prior.names[static_cast<std::size_t>(i)];
        if (!std::isfinite(prior.mean[i]))
            refuse_joint_prior("mean of \"" + name + "\" = " + fmt::to_string(prior.mean[i]) + " must be finite");
        const double variance = prior.covariance(i, i);
        if (!(variance > 0.0) || !std::isfinite(variance))
            refuse_joint_prior("variance of \"" + name + "\" = " + fmt::to_string(variance) +
                               " must be positive and finite");
    }
    for (Eigen::Index i = 0; i < count; ++i)
        for (Eigen::Index j = 0; j < i; ++j) {
            const double sds = std::sqrt(prior.covariance(i, i)) * std::sqrt(prior.covariance(j, j));
            if (!(std::abs(prior.covariance(i, j) - prior.covariance(j, i)) <= symmetry_tolerance * sds))
                refuse_joint_prior("covariance[" + std::to_string(i) + "][" + std::to_string(j) +
                                   "] = " + fmt::to_string(prior.covariance(i, j)) + " and covariance[" +
                                   std::to_string(j) + "][" + std::to_string(i) +
                                   "] = " + fmt::to_string(prior.covariance(j, i)) + ": must be symmetric");
        }
    const Factor factor = factorise(prior.covariance);
    // A pivot at the rounding of its sum is not positive.
    const Eigen::MatrixXd& lower = factor.correlation.lower();
    const double least = factor.correlation.positive_definite() ? lower.diagonal().minCoeff() : 0.0;
    if (!(least * least > 1e-14 * static_cast<double>(count)))
        refuse_joint_prior("covariance must be positive definite: some combination of the parameters has no variance");
}

}  // namespace orbid::estimator
