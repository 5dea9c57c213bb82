#pragma once

#include <cstddef>
#include <string>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include "estimator/errors/noise_model.hpp"
#include "estimator/estimate/estimate.hpp"
#include "estimator/interface/mapped_residual.hpp"
#include "estimator/interface/not_finite.hpp"
#include "estimator/problem/coordinate.hpp"
#include "estimator/problem/tie.hpp"

namespace orbid::estimator {

/// One unknown of an estimate with its coordinate u: a parameter, or an error parameter of a group.
struct Unknown {
    std::string name;  ///< "K_m"; for error parameters "group.scale", "group.dof", ...
    std::string unit;
    std::size_t place = 0;        ///< among all unknowns
    Eigen::Index parameter = -1;  ///< index among the parameters that are not tied; -1: an error parameter
    std::string group;            ///< of an error parameter
    std::string error;            ///< "scale", "dof", "relative", "correlation"
    double value = 0.0;           ///< at the estimate, natural
    double u = 0.0;               ///< at the estimate
    double sd = 0.0;              ///< in u, Laplace's; nan when undetermined or at a bound
    double size = 1.0;            ///< a typical change of u
    double lower = 0.0;           ///< limits of u, may be infinite
    double upper = 0.0;
    double natural_lower = 0.0;  ///< of the same limits
    /// sd of the estimate over Laplace's: not 1 with a sandwich, and where links are slack. The objective divided by
    /// its square is adjusted.
    double widening = 1.0;
    double degrees_of_freedom = nan_value;  ///< of the sandwich; nan without one
    bool too_few_independent = false;       ///< the estimate says that the record has no interval for it
    double natural_upper = 0.0;
};

/// Start of a minimisation: all values that an estimate finds.
struct ConditionalStart {
    Eigen::VectorXd theta;                               ///< natural, not tied ones
    std::vector<std::vector<Eigen::VectorXd>> latents;   ///< per residual, per block
    std::vector<std::pair<std::string, double>> errors;  ///< value of "group.scale", "group.dof" ...
};

/// An estimate with one of its unknowns held at a value.
struct ConditionalEstimate {
    EstimateStatus status = EstimateStatus::failed;
    std::string message;
    double objective = 0.0;     ///< as Estimate
    double log_integral = 0.0;  ///< as Estimate: the unknown itself is not integrated over, its prior not included
    ConditionalStart at;
    int evaluations = 0;

    /// Comparable with its neighbours: at a minimum, with all blocks of the estimate active.
    [[nodiscard]] bool good() const {
        return status == EstimateStatus::converged || status == EstimateStatus::singular;
    }
};

/// Repeated estimates from the same data with one unknown held: profile likelihoods and nested Laplace.
///
/// Sets of blocks stay those of the estimate. at() may be called from several threads.
class Conditional {
public:
    /// @param estimate  a finished estimate of the same parameters and residuals, the start of every minimisation.
    /// @throws std::invalid_argument when the estimate has other parameters, or failed.
    Conditional(const std::vector<FreeParameter>& parameters, const std::vector<const Residual*>& residuals,
                const EstimateOptions& options, const Estimate& estimate);

    /// All parameters that are not tied, then all estimated error parameters except those of full covariances, which
    /// belong together.
    [[nodiscard]] const std::vector<Unknown>& unknowns() const { return unknowns_; }
    /// The unknowns of these names; all without names. @throws models::DataError when a name is none of them: an error
    /// parameter without records is not estimated.
    [[nodiscard]] std::vector<Unknown> named(const std::vector<std::string>& names) const;

    [[nodiscard]] double natural(const Unknown& unknown, double u) const;
    /// u of a natural value.
    [[nodiscard]] double coordinate(const Unknown& unknown, double value) const;
    /// ln prior density of the unknown in its coordinate: 0 for flat, -infinity outside the support. For a joint prior:
    /// its marginal; at() uses the rest conditionally.
    [[nodiscard]] double log_prior(const Unknown& unknown, double u) const;

    [[nodiscard]] const ConditionalStart& start() const { return start_; }
    /// A start with the unknown moved to u and the others moved linearly (by Laplace's covariance), within their
    /// bounds.
    [[nodiscard]] ConditionalStart moved(const ConditionalStart& from, const Unknown& unknown, double u) const;
    /// Minimises over everything else. @throws nothing for points that cannot be evaluated: see status.
    [[nodiscard]] ConditionalEstimate at(const Unknown& unknown, double u, const ConditionalStart& from,
                                         Variance variance, bool full_hessian) const {
        return run(&unknown, u, from, variance, full_hessian);
    }
    /// Minimises over everything, from the estimate.
    [[nodiscard]] ConditionalEstimate free(Variance variance, bool full_hessian) const {
        return run(nullptr, 0.0, start_, variance, full_hessian);
    }

    [[nodiscard]] const std::vector<FreeParameter>& parameters() const { return tied_.parameters; }
    /// Full theta (tied ones included) from the parameters that are not tied.
    [[nodiscard]] Eigen::VectorXd expand(const Eigen::VectorXd& theta) const { return tied_.map.expand(theta); }

private:
    void add_parameters(const Estimate& estimate);
    void add_error_parameters(const std::vector<const Residual*>& residuals, const Estimate& estimate);
    [[nodiscard]] const ErrorCoordinate& error_coordinate(const Unknown& unknown) const {
        return error_coordinates_[unknown.place - coordinates_.size()];
    }
    [[nodiscard]] double slope(const Unknown& unknown, double u) const;  ///< d natural / du
    [[nodiscard]] std::vector<ErrorOverride> error_overrides(const ActiveSet& active, const Unknown* held, double value,
                                                             const ConditionalStart& from) const;
    [[nodiscard]] ConditionalEstimate run(const Unknown* unknown, double u, const ConditionalStart& from,
                                          Variance variance, bool full_hessian) const;
    [[nodiscard]] std::vector<JointNormalPrior> joint_priors_without(const std::string& name, double value) const;

    TiedProblem tied_;
    EstimateOptions options_;
    std::vector<ActiveSet> active_;
    std::vector<Unknown> unknowns_;
    std::vector<Coordinate> coordinates_;             ///< of the parameters
    std::vector<ErrorCoordinate> error_coordinates_;  ///< of the error parameters among the unknowns
    Eigen::MatrixXd covariance_;                      ///< covariance of the parameters in u, zero where undetermined
    ConditionalStart start_;
};

}  // namespace orbid::estimator
