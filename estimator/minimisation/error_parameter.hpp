#pragma once

#include <optional>
#include <vector>

#include <Eigen/Core>

#include "estimator/problem/block_set.hpp"
#include "estimator/problem/bounded_step.hpp"
#include "estimator/problem/linearisation.hpp"

namespace orbid::estimator {

/// The error parameters as a separate minimisation, Phi_psi of (M9), at a fixed linearisation:
///
///     Phi_psi = sum_g -ln p_g - ln p(psi) + 1/2 ln|H|
///
/// H over the latent states (ml, integrated) or over latent states and determined parameters (restricted), with the
/// expected information of the errors. Errors are taken at the minimum of the quadratic model over z for each psi. With
/// Follow::all it is the minimum over (theta, z) of errors and parameter prior: the min in (M9). Far from the minimum
/// the model promises too much of theta. Latent states must always follow, or those that start at the data send a scale
/// to zero.
enum class Follow { latents, all };

/// See above.
struct ErrorProblem {
    const BlockSet* set = nullptr;
    const std::vector<NoiseModel>* laws = nullptr;
    const std::vector<BlockRows>* rows = nullptr;  ///< the linearisation, columns of u
    Eigen::MatrixXd basis;           ///< determined directions y, u = basis y, shape (q, rank): BoundedStep::from_data
    Eigen::MatrixXd prior_rows;      ///< square root of the curvature of the parameter prior times basis
    Eigen::VectorXd prior_gradient;  ///< basis^T gradient, shape (rank)
    std::vector<bool> free;          ///< error parameters that are estimated and have data
    double matching = 1.0;           ///< see standard_arrow()
    bool restricted = true;
    Follow follow = Follow::latents;
};

/// The step of parameters and latent states that errors follow: to the minimum of the quadratic model.
struct ErrorStep {
    Eigen::VectorXd y;                 ///< of the determined parameters
    Eigen::VectorXd u;                 ///< basis y
    std::vector<Eigen::VectorXd> d_z;  ///< empty: neither moves
};

/// Value and gradient of Phi_psi; shape (error parameters).
struct ErrorPoint {
    double value = 0.0;
    Eigen::VectorXd gradient;
    /// For scales of laws that depend on squares only: sum of squares of the whitened errors, and records less trace;
    /// else 0.
    Eigen::VectorXd fit;
    Eigen::VectorXd left;
    double rest = 0.0;       ///< sum of all squares at the minimum of the quadratic model over z and theta, no prior
    WhitenedArrow standard;  ///< rows kept
    ReducedProblem reduced_problem;  ///< in the columns of u
    Eigen::MatrixXd triangle;        ///< R of the determined parameters with prior, latent states eliminated
    ErrorStep step;

    /// Frees all that has a part for every block.
    void drop_factors() {
        standard = {};
        reduced_problem.drop_blocks();
        step = {};
    }
};

/// d/dpsi_k = d(-ln p)/dpsi_k + tr(P S^T dS/dpsi_k), P = covariance of (z, theta) ("ml": of z), see (M10) for scales.
[[nodiscard]] ErrorPoint evaluate_errors(const ErrorProblem& problem, const Eigen::VectorXd& psi);
/// The same where the rows are whitened and factorised already. @param standard  at psi, with the expected curvature
/// and rows kept.
[[nodiscard]] ErrorPoint evaluate_errors(const ErrorProblem& problem, const Eigen::VectorXd& psi,
                                         WhitenedArrow standard);

/// Covariance of u that enters (M10): of the determined parameters if restricted, shape (q, q), else (0, 0).
[[nodiscard]] Eigen::MatrixXd parameter_covariance(const ErrorProblem& problem, const ErrorPoint& point);

/// From so many records on, error parameters need not be better than the parameters are at a step.
inline constexpr Eigen::Index many_records = 2000;

/// Whether one evaluation of the error parameters takes so long that searches save some: below, an estimate takes well
/// under a second whatever is done.
[[nodiscard]] bool is_long(const BlockSet& set);

/// Second derivatives of Phi_psi with respect to the free error parameters, shape (free, free): by central differences
/// of its gradient. Where one normal scale without prior whitens the whole problem it is 2 ||e||^2 / s^2, with theta at
/// its best if it follows.
/// @param point  of evaluate_errors() at psi, whatever follows there.
[[nodiscard]] Eigen::MatrixXd error_hessian(const ErrorProblem& problem, const ErrorPoint& point,
                                            const Eigen::VectorXd& psi, const std::vector<Eigen::Index>& free);

struct ErrorMinimum {
    Eigen::VectorXd psi;
    double before = 0.0;
    double after = 0.0;  ///< <= before
    int steps = 0;
    /// largest |gradient| of a free parameter over the root of its curvature: distance to the minimum in sds
    double distance = 0.0;
    std::vector<bool> at_floor;    ///< held at its lower limit; for a scale: residuals at rounding level
    std::vector<bool> at_ceiling;  ///< held at its upper limit
    /// Where Phi_psi was last evaluated: psi, or where the last step began if it was taken without a trial.
    Eigen::VectorXd evaluated;
    std::optional<WhitenedArrow> standard;  ///< factorised there; none: it was given up
};

/// What a minimisation learned about the curvature of Phi_psi over the free parameters, for the next one.
struct ErrorCurvature {
    std::vector<Eigen::Index> free;
    Eigen::MatrixXd hessian;
};

/// Stopping rules of a minimisation.
struct ErrorSearch {
    /// Distance to the minimum, in sds, that is close enough; below 1e-12 no figure of a result changes.
    double tolerance = 1e-12;
    /// > 0: a Newton step that changes no psi by more is taken without a trial, as the last one. For searches that are
    /// soon repeated.
    double untried = 0.0;
    ErrorCurvature* known = nullptr;  ///< curvature to start with and to leave behind; null: computed anew
};

/// Fixed-point steps of (M10) far from the minimum, secant steps near it; each accepted step decreases Phi_psi.
///
/// @param floor, ceiling  limits of psi.
/// @param standard       what is factorised at psi already, see evaluate_errors(); none: computed here.
[[nodiscard]] ErrorMinimum minimise_errors(const ErrorProblem& problem, const Eigen::VectorXd& psi,
                                           const Eigen::VectorXd& floor, const Eigen::VectorXd& ceiling,
                                           const ErrorSearch& search = {},
                                           std::optional<WhitenedArrow> standard = std::nullopt);

/// Scales of normal errors at which the weight used by steps equals the expected weight under the conditional density
/// of ln s: s^-2 = E[s^-2 | theta]. With Jeffreys' prior this is the minimum of (M9) itself. With another prior the
/// expectation is taken by Gauss-Hermite quadrature around it.
[[nodiscard]] Eigen::VectorXd integrated_scales(const ErrorProblem& problem, const ErrorMinimum& minimum);

}  // namespace orbid::estimator
