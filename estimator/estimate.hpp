#pragma once

#include <functional>
#include <limits>
#include <string>
#include <string_view>
#include <vector>

#include <Eigen/Core>

#include "estimator/detail/matrix_layout.hpp"
#include "estimator/prior.hpp"
#include "estimator/residual.hpp"

#pragma GCC visibility push(default)

namespace orbid::estimator {

/// The coordinate in which steps, mode and Laplace covariance are taken.
///
/// log10 is log in other units of the step; logit is ln((x - lower) / (upper - x)) and needs finite bounds.
enum class Scale { linear, log, log10, logit };

/// One estimated parameter.
struct FreeParameter {
    std::string name;
    std::string unit;
    double start = 0.0;
    Scale scale = Scale::linear;                              ///< log needs start > 0 and lower >= 0
    double lower = -std::numeric_limits<double>::infinity();  ///< inclusive
    double upper = std::numeric_limits<double>::infinity();
    Prior prior = FlatPrior{};
    double typical_size = 1.0;  ///< > 0: unit of null directions and steps where value and prior say nothing
    /// Name of another free parameter that this one follows, value = tie_factor * its value; empty = free. A tied
    /// parameter has no prior, bounds, scale or start of its own.
    std::string tied_to;
    double tie_factor = 1.0;  ///< finite, not 0
};

/// A quantity computed from the estimated parameters, with its gradient.
struct DerivedQuantity {
    std::string name;
    std::function<double(const Eigen::VectorXd& theta)> value;
    std::function<Eigen::VectorXd(const Eigen::VectorXd& theta)> gradient;  ///< shape (parameters)
};

/// ml, restricted: error parameters at the minimum of (M9). integrated: scales of normal errors and full covariances
/// are integrated out under Jeffreys' prior or their own, others as with ml.
enum class Variance { ml, restricted, integrated };

/// Which records may depend on each other in a way that the error model does not say, for the sandwich covariance.
///
/// automatic: stretches of consecutive records of ordered groups whose residuals are autocorrelated, no others.
/// blocks: all records of a block (panels, cycles, runs), blocks independent of each other. none: every interval from
/// Laplace's covariance.
enum class Clusters { automatic, blocks, none };

/// Why a minimisation ended, and what the estimate is worth.
enum class EstimateStatus { converged, no_progress, iteration_limit, singular, failed, interrupted };
[[nodiscard]] std::string_view name(EstimateStatus status);

struct EstimateOptions {
    /// Priors that several parameters share.
    std::vector<JointNormalPrior> joint_priors;
    Variance variance = Variance::restricted;
    /// With fewer than two blocks, or blocks linked by constraints, `blocks` is not possible: Laplace, and the message
    /// says so.
    Clusters clusters = Clusters::automatic;
    int maximum_iterations = 200;  ///< theta steps, over all rounds, > 0
    int maximum_rounds = 20;       ///< minimisations with a frozen set of blocks, provisional ones not counted, > 0
    double step_tolerance = 1e-6;  ///< converged when every step is below this many posterior sds (see Minimum), > 0
    /// Below this share of the largest (columns at unit length) a direction carries no information: the geometric
    /// middle between the noise of integrated derivatives (1e-10) and the weakest directions that are still determined
    /// (1e-5).
    double relative_singular_value = 3e-8;
    /// Whether the normal approximation is checked against the objective itself (a few evaluations per parameter).
    bool verdict = true;
    /// log_integral with the determinant of the full Hessian instead of the Gauss-Newton one (2 evaluations with
    /// derivatives per parameter).
    bool full_hessian = false;
    std::function<bool()> interrupted;                              ///< asked between steps; empty = never
    std::function<void(int iteration, double objective)> progress;  ///< called after every accepted step; may be empty
};

/// One estimated or derived number with its uncertainty.
struct Estimated {
    std::string name;
    std::string unit;
    double value = 0.0;
    double start = 0.0;
    double sd = 0.0;  ///< nan when undetermined (singular direction, at a bound)
    double lower95 = 0.0;
    double upper95 = 0.0;
    std::string interval_method;  ///< "t", "normal", "satterthwaite", "sandwich", "effective_count", "none"
    std::string at_bound;         ///< "", "lower" or "upper"
    /// sd if the errors were independent; equal to sd unless interval_method is "sandwich" or "effective_count"
    double laplace_sd = 0.0;
    /// Share of the posterior information on this parameter that the data bring, in [0, 1]; 0 = the prior alone
    /// decides.
    double data_share = 1.0;
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
    std::string interval_method = "none";  ///< "chi_squared", "normal" (in ln s) or "none"
    std::size_t count = 0;                 ///< records
    double rms = 0.0;                      ///< root mean square of the raw residuals, in the group's data unit
    double lag1 = 0.0;                     ///< lag-1 autocorrelation (ordered groups; nan otherwise)
    double correlation_records = 1;        ///< integrated autocorrelation time in records (ordered groups)
    double effective_count = 0;            ///< how many independent values the records are worth
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
};

/// One accepted or rejected step, for the history.
struct StepRecord {
    int round = 0;           ///< provisional ones counted
    std::string_view block;  ///< "theta" or "scales"
    bool accepted = false;
    double before =
        0.0;  ///< objective of this step's own block before and after: Phi at fixed psi, Phi_psi at fixed theta
    double after = 0.0;
    double damping = 0.0;
    std::string_view reason;   ///< "", "no decrease", "block failed", "bound"
    bool provisional = false;  ///< in a provisional round
};

struct NullDirection {
    Eigen::VectorXd components;  ///< in log parameters (relative changes), largest component 1; shape (parameters)
};

/// A product of powers of parameters that the data know within a factor e or worse, while they know others well.
struct SloppyDirection {
    Eigen::VectorXd
        components;   ///< exponents, simple fractions where the data cannot tell; largest 1, shape (parameters)
    double sd = 0.0;  ///< of the product's logarithm, from the data alone, >= 1 or so
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
    Eigen::MatrixXd correlation;                     ///< shape (parameters, parameters); nan rows where undetermined
    Eigen::VectorXd singular_values;                 ///< of the scaled sensitivity matrix of the data, descending
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
    /// psi), flat priors counting as 1: the log evidence up to what flat priors leave open.
    double log_integral = 0.0;
    double degrees_of_freedom = 0;
    int iterations = 0;
    int evaluations = 0;
    int rounds = 0;  ///< provisional ones included
    /// Length of the full step that is left, in posterior sds; nan without a step. Half of its square is what the
    /// objective lies above its minimum, to second order.
    double remaining = std::numeric_limits<double>::quiet_NaN();
    std::vector<StepRecord> history;
};

/// Verbeek's modified off-line Bayesian estimator: theta, latent states and error scales from residuals (M8)-(M11).
///
/// Estimates with wrong options, starts outside their bounds, a log scale with a start <= 0 or duplicate names are
/// refused with std::invalid_argument naming value and rule.
[[nodiscard]] Estimate estimate(const std::vector<FreeParameter>& parameters, const std::vector<Residual*>& residuals,
                                const std::vector<DerivedQuantity>& derived = {}, const EstimateOptions& options = {});

}  // namespace orbid::estimator

#pragma GCC visibility pop
