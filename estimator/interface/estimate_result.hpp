#pragma once

#include <cstddef>
#include <limits>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <Eigen/Core>

#include "estimator/interface/eigen_layout.hpp"
#include "estimator/interface/prior.hpp"
#include "estimator/interface/residual.hpp"

#pragma GCC visibility push(default)

namespace orbid::estimator {

/// Why a minimisation ended, and how valid the estimate is.
enum class EstimateStatus { converged, no_progress, iteration_limit, singular, failed, interrupted };
[[nodiscard]] std::string_view name(EstimateStatus status);

/// What an interval of 95 % rests on. In estimator/uncertainty: the normal density; t with one estimated scale;
/// Satterthwaite's degrees of freedom with several; a sandwich (long-run variance of the scores, or blocks). Of error
/// scales also chi squared. `fixed`: the value was given; `none`: there is no interval. `too_few_independent`: there is
/// none because the residuals repeat each other over most of the record. `likelihood`: where it has fallen to that of
/// 1.96 sds, for the correlation of autoregressive errors.
enum class IntervalMethod {
    none,
    normal,
    t,
    satterthwaite,
    sandwich,
    too_few_independent,
    chi_squared,
    fixed,
    likelihood
};
[[nodiscard]] std::string_view name(IntervalMethod method);

/// The bound that holds a parameter.
enum class BoundSide { none, lower, upper };
/// "" for none.
[[nodiscard]] std::string_view name(BoundSide side);

/// One estimated or derived number with its uncertainty.
struct Estimated {
    std::string name;
    std::string unit;
    double value = 0.0;
    double start = 0.0;
    double sd = 0.0;  ///< nan when undetermined (singular direction, at a bound)
    /// Ends of the interval, never beyond bounds; nan where the data tell no order of magnitude.
    double lower95 = 0.0;
    double upper95 = 0.0;
    IntervalMethod interval_method = IntervalMethod::none;
    BoundSide at_bound = BoundSide::none;
    /// sd by the curvature, as if errors were independent and slack were errors; equal to sd without sandwich and slack
    double laplace_sd = 0.0;
    /// Share of the posterior information on this parameter that comes from the data, in [0, 1]; 0 = from the prior
    /// alone.
    double data_share = 1.0;
    /// Of the t quantile of a sandwich's interval; nan otherwise.
    double interval_degrees_of_freedom = std::numeric_limits<double>::quiet_NaN();
    /// The end of the interval that is a one-sided limit of 95 %; the other end is a bound. See bounded_interval().
    BoundSide limit = BoundSide::none;
    /// What unbiased() took off: the minimum of the objective is about value + bias.
    double bias = 0.0;
};

struct EstimatedScale {
    std::string group;
    std::string unit;
    bool factor = false;
    bool estimated = true;
    double value = 0.0;
    double uncertainty = 0.0;                                   ///< sd of value (Laplace in ln s); 0 when fixed
    double lower95 = std::numeric_limits<double>::quiet_NaN();  ///< nan when fixed or held at a limit
    double upper95 = std::numeric_limits<double>::quiet_NaN();
    IntervalMethod interval_method = IntervalMethod::none;  ///< chi_squared, normal (in ln s) or none
    std::size_t count = 0;                                  ///< records
    double rms = 0.0;                ///< root mean square of the raw residuals, in the group's data unit
    double lag1 = 0.0;               ///< lag-1 autocorrelation (ordered groups; nan otherwise)
    double correlation_records = 1;  ///< integrated autocorrelation time in records (ordered groups)
    double effective_count = 0;      ///< equivalent number of independent records
    std::string distribution = "normal";
    /// Further parameters of the distribution: "dof", "relative", "correlation".
    std::vector<Estimated> shape;
};

/// Full covariance of several responses.
struct EstimatedCovariance {
    std::vector<std::string> groups;
    Eigen::MatrixXd value;        ///< shape (m, m)
    Eigen::MatrixXd uncertainty;  ///< sd of each element (Laplace)
};

struct ResidualCount {
    std::string type;
    int used = 0;
    int lost = 0;
    int rejected = 0;
    int added = 0;
    std::vector<std::string> unused = {};  ///< labels of the blocks that take no part in the estimate
};

/// What a step moves: the parameters with the latent states, or the error parameters.
enum class StepBlock { theta, scales };
[[nodiscard]] std::string_view name(StepBlock block);

/// Why a step is rejected: the objective does not fall, or a block of a residual cannot be evaluated at its end.
enum class StepRejection { none, no_decrease, block_failed };
/// "" for none.
[[nodiscard]] std::string_view name(StepRejection reason);

/// One accepted or rejected step, for the history.
struct StepRecord {
    int round = 0;  ///< including those of intermediate stages
    StepBlock block = StepBlock::theta;
    bool accepted = false;
    /// Objective of this step's own block before and after: Phi at fixed psi, Phi_psi at fixed theta.
    double before = 0.0;
    double after = 0.0;
    double damping = 0.0;
    StepRejection reason = StepRejection::none;
    bool provisional = false;  ///< in an intermediate stage
};

struct NullDirection {
    Eigen::VectorXd components;  ///< in log parameters (relative changes), largest component 1; shape (parameters)
    std::string told = {};       ///< what the data tell of these parameters: "k2 / m and k3 / m"; empty: nothing
};

/// A product of powers of parameters that the data determine only within a factor e or worse, but others well.
struct SloppyDirection {
    Eigen::VectorXd components;  ///< exponents, simple fractions where the data allow it; largest 1, shape (parameters)
    double sd = 0.0;             ///< of the product's logarithm, from the data alone, >= 1 or so
    std::string told = {};       ///< see NullDirection
};

struct Estimate {
    EstimateStatus status = EstimateStatus::failed;
    std::string message;
    std::vector<Estimated> parameters;
    std::vector<Estimated> derived;
    std::vector<EstimatedScale> scales;
    std::vector<EstimatedCovariance> covariances;
    std::vector<std::vector<Eigen::VectorXd>> latents;  ///< per residual, per block
    std::vector<std::vector<Eigen::VectorXd>> latent_sds;
    std::vector<std::vector<BlockValue>> residuals;  ///< per residual, per block, at the estimate (e only)
    Eigen::MatrixXd covariance;                      ///< of theta in natural units, consistent with the sds reported
    Eigen::MatrixXd laplace_covariance;  ///< the same by the curvature of the objective, consistent with laplace_sd
    Eigen::MatrixXd correlation;         ///< shape (parameters, parameters); nan rows where undetermined
    Eigen::VectorXd singular_values;     ///< of the scaled sensitivity matrix of the data, descending
    std::vector<NullDirection> null_directions;
    std::vector<SloppyDirection> sloppy_directions;
    bool trust_normal = true;  ///< false: use profile likelihood, nested Laplace or sampling for intervals
    std::string distrust;      ///< why not, naming the parameter; empty when trusted
    /// sd from the full Hessian over sd from the Gauss-Newton one, per parameter; nan where undetermined or unknown.
    Eigen::VectorXd hessian_ratio;
    double effective_count = 0;
    std::vector<ResidualCount> counts;
    double objective = 0.0;       ///< Phi_psi at the estimate
    double log_likelihood = 0.0;  ///< ln p(y | theta, z, psi)
    /// Laplace's value of ln of the integral of p(y | theta, z, psi) p(theta) p(psi) over all coordinates (theta, z,
    /// psi), with flat priors counting as 1. It is the log evidence up to the factor that flat priors leave open.
    double log_integral = 0.0;
    double degrees_of_freedom = 0;
    int iterations = 0;
    int evaluations = 0;
    int rounds = 0;  ///< including those of intermediate stages
    /// Length of the remaining full step, in posterior sds; nan without a step. To second order the objective lies
    /// above its minimum by half of its square.
    double remaining = std::numeric_limits<double>::quiet_NaN();
    std::vector<StepRecord> history;
    std::vector<ActiveSet> active;  ///< per residual: blocks, fixed scales and memory at the end
    /// A slope that the objective had beside the residuals and priors, see Tilt. What explores the objective around the
    /// estimate takes it among its joint priors.
    std::optional<JointNormalPrior> tilt;
    std::string bias_left;  ///< why unbiased() took nothing off; empty: it did, or was not asked
};

}  // namespace orbid::estimator

#pragma GCC visibility pop
