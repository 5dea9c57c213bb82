#pragma once

#include <functional>
#include <limits>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "estimator/interface/eigen_layout.hpp"
#include "estimator/interface/prior.hpp"

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
    double typical_size = 1.0;  ///< > 0: unit of null directions and steps where value and prior give none
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

/// Which records may depend on each other beyond what the error model says, for the sandwich covariance.
///
/// automatic: runs of consecutive records of ordered groups whose residuals are autocorrelated, no others. blocks: all
/// records of a block (panels, cycles, runs), blocks independent of each other. none: every interval from Laplace's
/// covariance.
enum class Clusters { automatic, blocks, none };

/// A minimisation at its start and after an accepted step, or what follows it.
struct StepReport {
    enum class Phase { minimisation, uncertainty };
    Phase phase = Phase::minimisation;
    int iteration = 0;         ///< accepted steps, over all rounds
    int round = 0;             ///< from 1
    bool provisional = false;  ///< an intermediate stage
    double objective = 0.0;
    double decrease = std::numeric_limits<double>::quiet_NaN();  ///< of the objective by this step
    double damping = std::numeric_limits<double>::quiet_NaN();   ///< lambda of this step; 0: a full one
    double step = std::numeric_limits<double>::quiet_NaN();      ///< full step from before it, in posterior sds
    Eigen::VectorXd theta{};                                     ///< reached, natural units
};

struct EstimateOptions {
    /// Priors that several parameters share.
    std::vector<JointNormalPrior> joint_priors;
    Variance variance = Variance::restricted;
    /// With fewer than two blocks, or blocks linked by constraints, `blocks` is not possible: Laplace is used, with a
    /// message.
    Clusters clusters = Clusters::automatic;
    int maximum_iterations = 200;  ///< theta steps, over all rounds, > 0
    int maximum_rounds = 20;       ///< minimisations with a frozen set of blocks, without intermediate stages, > 0
    double step_tolerance = 1e-6;  ///< converged when every step is below this many posterior sds (see Minimum), > 0
    /// Below this fraction of the largest (columns at unit length) a direction carries no information. It is the
    /// geometric mean of the noise of integrated derivatives (1e-10) and the weakest directions that are still
    /// determined (1e-5).
    double relative_singular_value = 3e-8;
    /// Whether the normal approximation is checked against the objective itself (a few evaluations per parameter).
    bool verdict = true;
    /// Sds of the error parameters, and what they add to the intervals of the parameters. Without them, which suits the
    /// start of another estimate, these sds are nan, parameters have normal intervals, and log_integral leaves out the
    /// error parameters.
    bool error_uncertainties = true;
    /// log_integral with the determinant of the full Hessian instead of the Gauss-Newton one (2 evaluations with
    /// derivatives per parameter).
    bool full_hessian = false;
    std::function<bool()> interrupted;                              ///< called between steps; empty = never
    std::function<void(int iteration, double objective)> progress;  ///< called after every accepted step; may be empty
    /// Called at the start of every minimisation, after every accepted step, and before uncertainties are computed; may
    /// be empty.
    std::function<void(const StepReport& report)> watched{};
};

}  // namespace orbid::estimator

#pragma GCC visibility pop
