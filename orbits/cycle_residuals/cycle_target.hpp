#pragma once

#include <cstddef>
#include <limits>
#include <span>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "estimator/interface/residual.hpp"
#include "models/arithmetic/matrix_layout.hpp"
#include "models/system/system.hpp"
#include "orbits/cycles/cycle.hpp"
#include "orbits/records/error_form.hpp"
#include "orbits/simulation/section_map.hpp"

#pragma GCC visibility push(default)

namespace orbid::orbits {

/// How the measured cycles are weighted (mathematics.md, section 5).
///
/// covariance  V_c = D Sigma_c D: Sigma_c from the orbit analysis, D one unknown factor per coordinate
/// equal       Sigma_c = I: D is the sd of a point in the coordinate's unit
enum class CycleWeights { covariance, equal };

/// Which measured cycles are used, and how.
struct CycleTargetOptions {
    std::vector<int> periods;  ///< prime periods used; empty: all
    CycleWeights weights = CycleWeights::covariance;
    bool positions = true;     ///< the points are used
    bool multipliers = false;  ///< ln|multiplier| is used, group "cycles.ln_multiplier"
    /// Error of ln|multiplier|: a factor on the analysis' covariance, or with weights "equal" its sd.
    estimator::ErrorScale multiplier_error;
    /// T is used where it was measured (Cycle::time): autonomous flows; group "cycles.time" [s].
    bool times = false;
    estimator::ErrorScale time_error;  ///< likewise
    /// How the series with these points was read: the points are readings of the model's states.
    models::Sensor sensor;
    std::vector<estimator::ErrorScale> errors;  ///< one per coordinate; empty: estimated, started from the residuals
    /// One per coordinate; empty: normal. Weights "covariance": normal only, because the analysis' covariance couples
    /// the coordinates. "equal": normal, Student's t and Laplace.
    std::vector<ErrorForm> forms;
    /// Coordinates (as groups) with one full covariance; weights "equal" only.
    std::vector<estimator::JointCovariance> covariances;
};

/// @throws DataError naming the first cycle that lacks a covariance which the weights need.
void check_weights(const std::vector<Cycle>& cycles, const CycleTargetOptions& options);

/// A measured cycle as the target of a residual.
struct CycleTarget {
    std::size_t cycle = 0;  ///< index into the list that was given
    std::string label;      ///< "cycle 3 (period 2)"
    std::vector<int> rotation;
    Eigen::MatrixXd points;  ///< shape (n, p): as read
    Eigen::MatrixXd nodes;   ///< shape (n, p): the states with these readings at the start parameters
    bool positions = true;   ///< the points are used; false: withheld, or a state of rest
    /// Sigma_c of the points plus the error of a computed orbit, shape (n p, n p); empty = identity
    Eigen::MatrixXd covariance;
    /// The multipliers used, as indices into those of the model's orbit (largest modulus first). Complex pairs: the
    /// first of each; empty: none.
    std::vector<std::size_t> multipliers;
    std::vector<bool> pair;                 ///< whether each is the first of a complex pair
    Eigen::VectorXd ln_multiplier;          ///< ln|multiplier| as measured, same length
    Eigen::MatrixXd multiplier_covariance;  ///< of these; empty = identity
    /// Errors shared with other cycles (Cycle::common), rows: the points, then the multipliers used, then the time if
    /// used; part of all covariances. Empty: none.
    Eigen::MatrixXd common;
    double time = std::numeric_limits<double>::quiet_NaN();  ///< [s]; nan: not used
    double time_sd = 1.0;                                    ///< weights "equal": 1
    Eigen::VectorXd time_covariance;                         ///< with the points; empty: 0
};

/// The targets of an estimate, and the cycles that tell nothing about parameters.
struct CycleTargets {
    std::vector<CycleTarget> targets;
    /// States of rest. (0, 0) and (pi, 0) of a pendulum are orbits for all parameters; dry friction makes them a
    /// continuum. Their positions hold no information, but would count as measurements of the error scale. They are
    /// left out unless their multipliers are used; then they are targets too, without positions.
    std::vector<std::size_t> at_rest;
    /// Mirror images of cycles earlier in the list, left out. The search finds both from the same points: using both
    /// would make every sd too small by sqrt(2).
    std::vector<std::size_t> mirrored;
};

/// Chooses the cycles that are used. For a cycle of period 1 the orbit is solved from its point at the start
/// parameters. The cycle is a state of rest when this orbit, or the point one period later, is at rest for ever
/// (System::at_rest). It is also one when the orbit does not depend on any free parameter; for a fixed point of a map
/// only this counts. (Longer prime periods cannot be at rest, nor can crossings of a plane.)
///
/// A multiplier is used when it is finite and, with weights "covariance", its sd is at most `largest_multiplier_sd`.
/// (The logarithm of a value with larger normal errors is biased and skew.) ln|mu| of a complex pair counts once.
///
/// @param theta  full parameter vector of the system (start of the estimate).
/// @param free   free parameters.
/// @throws std::invalid_argument naming the cycle and the rule: wrong shapes, not finite, a covariance that is missing
///         or not symmetric positive definite (weights "covariance"), wrong number of errors, a distribution or a full
///         covariance that the weights do not allow, multipliers or times that no cycle has, neither positions nor
///         multipliers nor times, times of a system that is not an autonomous flow, a sensor that reads formulas.
[[nodiscard]] CycleTargets select_targets(const SectionMap& map, const Eigen::VectorXd& theta,
                                          std::span<const Eigen::Index> free, const std::vector<Cycle>& cycles,
                                          const CycleTargetOptions& options);

inline constexpr double largest_multiplier_sd = 0.5;

/// Group "prefix.coordinate" per coordinate (unless positions are withheld), with the errors of the options: factors
/// (unit 1) for weights "covariance", sds in the coordinate's unit for "equal". With multipliers also
/// "prefix.ln_multiplier", with times "prefix.time".
[[nodiscard]] std::vector<estimator::Group> target_groups(const SectionMap& map, const std::string& prefix,
                                                          const CycleTargetOptions& options);

/// Groups of n p records in the order of points, coordinate fastest: first, first + 1, .., repeated.
[[nodiscard]] std::vector<int> record_groups(Eigen::Index dimension, Eigen::Index points, int first);

/// Typical size of each coordinate: 2 pi for angles, else the range of the measured points about 0 (1 when all are 0).
[[nodiscard]] Eigen::VectorXd target_scale(std::span<const models::Coordinate> coordinates,
                                           const std::vector<Cycle>& cycles);

}  // namespace orbid::orbits

#pragma GCC visibility pop
