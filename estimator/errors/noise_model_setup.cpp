#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include <fmt/format.h>

#include "estimator/errors/error_density.hpp"
#include "estimator/errors/noise_model.hpp"
#include "estimator/interface/not_finite.hpp"
#include "models/arithmetic/cholesky_factor.hpp"

namespace orbid::estimator {

namespace {

using Kind = ErrorCoordinate::Kind;

/// Below one degree of freedom Student's likelihood is often unbounded. Above 1e4 it is indistinguishable from the
/// normal one (the densities differ by less than 1e-4 within four sd).
constexpr double least_dof = 1.0;
constexpr double most_dof = 1e4;
/// A relative error of 1e-9 is below the rounding of any simulated prediction: in effect zero, but with a logarithm.
constexpr double least_relative = 1e-9;
/// Innovations of an autoregression keep seven digits at this correlation.
constexpr double most_correlation = 1.0 - 1e-9;

[[noreturn]] void refuse(const Group& group, const std::string& what) {
    throw std::invalid_argument(fmt::format("group '{}': {}", group.name, what));
}

/// A coordinate with checked start and prior; its limits are those given (natural) less what the prior excludes.
ErrorCoordinate checked(const Group& group, const char* name, Kind kind, const ErrorParameter& parameter, double least,
                        double most) {
    ErrorCoordinate result{name, kind, parameter.estimate, parameter.value, parameter.prior, 0.0, 0.0};
    try {
        validate(parameter.prior);
    } catch (const std::invalid_argument& error) {
        refuse(group, fmt::format("{}: {}", name, error.what()));
    }
    if (parameter.estimate) {
        const Support ends = support(parameter.prior);
        least = std::max(least, ends.lower);
        most = std::min(most, ends.upper);
    }
    if (!(least < most)) refuse(group, fmt::format("{}: its prior excludes every admissible value", name));
    result.lower = result.at(least);
    result.upper = result.at(most);
    return result;
}

ErrorCoordinate scale_coordinate(const Group& group) {
    const ErrorScale& scale = group.scale;
    if (!(group.floor >= 0.0) || !std::isfinite(group.floor))
        refuse(group, fmt::format("floor = {}: must be >= 0 and finite", group.floor));
    if (!std::isfinite(scale.value)) refuse(group, fmt::format("scale = {}: must be finite", scale.value));
    if (!scale.estimate && !(scale.value > 0.0))
        refuse(group, fmt::format("scale = {}: a fixed scale must be positive", scale.value));
    ErrorCoordinate result = checked(group, "scale", Kind::log, {scale.estimate, scale.value, scale.prior},
                                     scale.estimate ? group.floor : 0.0, infinity);
    // A start to be taken from the residuals (<= 0) is kept; any other start has to lie where steps may go.
    if (scale.estimate && scale.value > 0.0)
        result.start = std::clamp(scale.value, result.natural(result.lower), result.natural(result.upper));
    return result;
}

/// dof, relative, correlation: `rule` says in words what [least, most] means.
ErrorCoordinate shape_coordinate(const Group& group, const char* name, Kind kind, ErrorParameter parameter,
                                 double least, double most, const char* rule) {
    // An estimate at a bound comes back from its logarithm with an error of rounding.
    constexpr double rounding = 1e-12;
    if (parameter.value > most && parameter.value - most <= rounding * most) parameter.value = most;
    if (parameter.value < least && least - parameter.value <= rounding * std::abs(least)) parameter.value = least;
    if (!(parameter.value >= least && parameter.value <= most))
        refuse(group, fmt::format("{} = {}: must be {}", name, parameter.value, rule));
    ErrorCoordinate result = checked(group, name, kind, parameter, least, most);
    if (parameter.estimate && !std::isfinite(negative_log_density(parameter.prior, parameter.value)))
        refuse(group, fmt::format("{} = {}: the start lies where its prior is zero", name, parameter.value));
    return result;
}

NoiseModel law_of_one(const Group& group, int channel) {
    NoiseModel law;
    law.distribution = group.distribution;
    law.channels = {channel};
    law.slack = group.slack && !group.scale.estimate;
    law.coordinates.push_back(scale_coordinate(group));
    if (const auto* student = std::get_if<StudentErrors>(&group.distribution)) {
        const ErrorCoordinate& dof = law.coordinates.emplace_back(
            shape_coordinate(group, "dof", Kind::log, student->dof, least_dof, most_dof, ">= 1 and <= 10000"));
        if (!dof.estimate) law.normalisation = detail::student_normalisation(dof.natural(dof.at(dof.start)));
    }
    if (const auto* relative = std::get_if<RelativeErrors>(&group.distribution))
        law.coordinates.push_back(
            shape_coordinate(group, "relative", Kind::log, relative->relative, least_relative, infinity, ">= 1e-9"));
    if (const auto* regression = std::get_if<AutoregressiveErrors>(&group.distribution))
        law.coordinates.push_back(shape_coordinate(group, "correlation", Kind::fisher, regression->correlation,
                                                   -most_correlation, most_correlation, "above -1 and below 1"));
    return law;
}

/// @param first  channel of groups[0].
NoiseModel law_of_several(const std::vector<Group>& groups, int first, const JointCovariance& covariance) {
    NoiseModel law;
    const auto m = static_cast<Eigen::Index>(covariance.groups.size());
    for (Eigen::Index j = 0; j < m; ++j) {
        const Group& group = groups[static_cast<std::size_t>(covariance.groups[static_cast<std::size_t>(j)])];
        if (!std::holds_alternative<NormalErrors>(group.distribution))
            refuse(group, "a full covariance needs normal errors");
        if (!group.scale.estimate) refuse(group, "a full covariance is estimated: its groups have no fixed scale");
        if (!std::holds_alternative<FlatPrior>(group.scale.prior))
            refuse(group, "within a full covariance a scale has no prior of its own (inverse-Wishart is that of V)");
        law.channels.push_back(first + covariance.groups[static_cast<std::size_t>(j)]);
        law.coordinates.push_back(scale_coordinate(group));
        law.coordinates.back().name = "covariance";
        for (Eigen::Index i = j + 1; i < m; ++i)
            law.coordinates.push_back({"covariance", Kind::linear, true, 0.0, FlatPrior{}, -infinity, infinity});
    }
    if (covariance.dof == 0.0) return law;
    const Group& group = groups[static_cast<std::size_t>(covariance.groups.front())];
    if (!(covariance.dof > static_cast<double>(m - 1)) || !std::isfinite(covariance.dof))
        refuse(group,
               fmt::format("inverse-Wishart dof = {}: must be above {} for {} responses", covariance.dof, m - 1, m));
    const Eigen::MatrixXd& psi = covariance.psi;
    if (psi.rows() != m || psi.cols() != m)
        refuse(group,
               fmt::format("inverse-Wishart psi has shape {} x {}: must be {} x {}", psi.rows(), psi.cols(), m, m));
    // A typed matrix is symmetric exactly; a computed one up to rounding.
    const bool symmetric = (psi - psi.transpose()).cwiseAbs().maxCoeff() <= 1e-12 * psi.cwiseAbs().maxCoeff();
    if (!psi.allFinite() || !symmetric || !models::CholeskyFactor(psi).positive_definite())
        refuse(group, "inverse-Wishart psi must be symmetric and positive definite");
    law.inverse_wishart_dof = covariance.dof;
    law.inverse_wishart_psi = psi;
    return law;
}

void check_members(const std::vector<Group>& groups, const JointCovariance& covariance, std::vector<bool>& taken) {
    if (covariance.groups.size() < 2)
        throw std::invalid_argument(
            fmt::format("a full covariance of {} groups: needs two or more", covariance.groups.size()));
    for (const int g : covariance.groups) {
        if (g < 0 || static_cast<std::size_t>(g) >= groups.size())
            throw std::invalid_argument(
                fmt::format("a full covariance names group {}: there are {}", g, groups.size()));
        if (taken[static_cast<std::size_t>(g)])
            refuse(groups[static_cast<std::size_t>(g)], "appears twice in full covariances");
        taken[static_cast<std::size_t>(g)] = true;
    }
}

}  // namespace

double ErrorCoordinate::natural(double psi) const {
    return kind == Kind::log ? std::exp(psi) : kind == Kind::fisher ? std::tanh(psi) : psi;
}

double ErrorCoordinate::at(double x) const {
    return kind == Kind::log ? std::log(x) : kind == Kind::fisher ? std::atanh(x) : x;
}

double ErrorCoordinate::slope(double psi) const {
    if (kind == Kind::fisher) return std::exp(-2.0 * detail::ln_cosh(psi));  // 1 - tanh^2 without the cancellation
    return kind == Kind::log ? std::exp(psi) : 1.0;
}

bool NoiseModel::compressible() const {
    return !joint() && (std::holds_alternative<NormalErrors>(distribution) ||
                        std::holds_alternative<LogNormalErrors>(distribution));
}

double NoiseModel::scale_information(const Eigen::VectorXd& psi) const {
    if (compressible()) return 2.0;
    // 2 nu / (nu + 3) (Lange, Little and Taylor 1989).
    if (std::holds_alternative<StudentErrors>(distribution)) return 2.0 / (1.0 + 3.0 * std::exp(-psi[1]));
    return std::holds_alternative<LaplaceErrors>(distribution) ? 1.0 : 0.0;
}

bool NoiseModel::has_one_curvature() const {
    return joint() || compressible() || std::holds_alternative<AutoregressiveErrors>(distribution);
}

bool NoiseModel::needs_observed() const {
    return std::holds_alternative<RelativeErrors>(distribution) ||
           std::holds_alternative<LogNormalErrors>(distribution);
}

double NoiseModel::scale(const Eigen::VectorXd& psi, std::size_t channel) const {
    if (!joint()) return std::exp(psi[0]);
    const auto m = static_cast<Eigen::Index>(channels.size());
    return detail::covariance_triangle<double>(psi, m).row(static_cast<Eigen::Index>(channel)).norm();
}

std::vector<NoiseModel> error_laws(const std::vector<const Residual*>& residuals,
                                   const std::vector<ActiveSet>& active) {
    if (active.size() != residuals.size())
        throw std::invalid_argument(fmt::format("{} active sets of {} residuals", active.size(), residuals.size()));
    std::vector<NoiseModel> laws;
    int first = 0;
    for (std::size_t r = 0; r < residuals.size(); ++r) {
        const std::vector<Group>& groups = active[r].groups;
        std::vector<bool> taken(groups.size(), false);
        for (const JointCovariance& covariance : residuals[r]->covariances()) {
            check_members(groups, covariance, taken);
            laws.push_back(law_of_several(groups, first, covariance));
        }
        for (std::size_t g = 0; g < groups.size(); ++g)
            if (!taken[g]) laws.push_back(law_of_one(groups[g], first + static_cast<int>(g)));
        first += static_cast<int>(groups.size());
    }
    const auto before = [](const NoiseModel& a, const NoiseModel& b) {
        return *std::min_element(a.channels.begin(), a.channels.end()) <
               *std::min_element(b.channels.begin(), b.channels.end());
    };
    std::sort(laws.begin(), laws.end(), before);
    Eigen::Index parameters = 0;
    for (NoiseModel& law : laws) {
        law.first = parameters;
        parameters += static_cast<Eigen::Index>(law.coordinates.size());
    }
    return laws;
}

}  // namespace orbid::estimator
