#pragma once

#include <complex>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "models/system/system.hpp"
#include "periodic/orbit/eigen_names.hpp"
#include "periodic/orbit/orbit.hpp"
#include "periodic/orbit/shooting_mesh.hpp"
#include "periodic/orbit/solver_options.hpp"

namespace orbid::periodic {

/// What all curves of a diagram have in common.
struct CurveSetting {
    const models::System& system;
    VectorXd theta;       ///< shape (q); the entry that is followed is replaced
    Index parameter = 0;  ///< which one
    double range = 1.0;   ///< unit of the parameter in the norm, > 0
    double phase = 0.0;   ///< of the section [rad] (forced models)
    std::optional<models::Section> section;
    ShootingOptions solver;

    [[nodiscard]] VectorXd theta_at(double value) const;
};

class OrbitCurve;

/// A solved orbit on a curve.
struct CurvePoint {
    std::shared_ptr<const OrbitCurve> curve;
    VectorXd y;                                     ///< the nodes below each other, ln T (autonomous), the parameter
    VectorXd tangent;                               ///< dy / d arclength, of norm one
    std::vector<MatrixXd> jacobians;                ///< of the segments
    MatrixXd columns;                               ///< derivatives of the images by ln T and parameter / range
    std::vector<std::complex<double>> multipliers;  ///< the trivial one of autonomous orbits not
    std::complex<double> trivial;                   ///< that one
    double residual = 0.0;                          ///< largest closing error
    double last_step = 0.0;                         ///< Newton's, in the norm: the jacobians are off by that
    int iterations = 0;
    bool sticking = false;

    [[nodiscard]] double parameter() const { return y(y.size() - 1); }
    /// How fast the parameter moves along the curve.
    [[nodiscard]] double parameter_slope() const { return tangent(tangent.size() - 1); }
    [[nodiscard]] int unstable() const;
};

/// How a correction towards the curve ended.
struct Correction {
    OrbitStatus status = OrbitStatus::no_progress;  ///< converged, no_progress, not_simulated or singular
    CurvePoint point;                               ///< meaningful if converged
    double distance = 0.0;                          ///< from the guess, in the norm of the continuation
    double contraction = 0.0;                       ///< second Newton step / first one; 0 when there was no second
    double unfolding = 0.0;                         ///< residual of the equations, where they were unfolded
};

/// The orbits of multiple shooting on one set of segments as a curve in the space of y = (nodes, ln T, parameter):
///
///     F_j(z_j; T, theta) - z_{j+1} - 2 pi turns_j = 0,     phase condition (autonomous flows).
///
///     |y|^2 = sum_j share_j |z_j / scale|^2 + (ln T)^2 + (parameter / range)^2,
///
/// which does not depend on the number of nodes, and is the same for an orbit followed p times (but for ln T). Forced
/// models are followed in the phase, so that their nodes keep their phases even if the parameter changes the period.
class OrbitCurve : public std::enable_shared_from_this<OrbitCurve> {
public:
    /// @param turns   whole turns per segment, shape (n, N).
    /// @param scale   unit of each coordinate, shape (n), > 0.
    /// @param phase   plane of Poincare's condition on the first node; needed exactly for autonomous flows.
    /// @param period  nominal period of an orbit on the curve, in periods of the forcing or returns.
    OrbitCurve(const CurveSetting& setting, ShootingMesh mesh, MatrixXd turns, VectorXd scale,
               std::optional<models::Section> phase, int period);

    [[nodiscard]] const CurveSetting& setting() const { return *setting_; }
    [[nodiscard]] const ShootingMesh& mesh() const { return mesh_; }
    [[nodiscard]] const MatrixXd& turns() const { return turns_; }
    [[nodiscard]] const VectorXd& scale() const { return scale_; }
    [[nodiscard]] const std::optional<models::Section>& phase() const { return phase_; }
    [[nodiscard]] int period() const { return period_; }
    [[nodiscard]] bool autonomous() const { return phase_.has_value(); }
    /// Whole turns over the orbit, one per angle coordinate.
    [[nodiscard]] std::vector<int> rotation() const;

    [[nodiscard]] Index size() const { return weights_.size(); }
    [[nodiscard]] MatrixXd nodes(const VectorXd& y) const;
    /// T [s] at y; iterations of a map.
    [[nodiscard]] double time(const VectorXd& y) const;
    /// y of the mesh itself.
    [[nodiscard]] VectorXd at_mesh(double parameter) const;
    [[nodiscard]] double product(const VectorXd& a, const VectorXd& b) const;
    [[nodiscard]] double norm(const VectorXd& a) const;
    /// The direction in which the parameter alone grows, of norm one.
    [[nodiscard]] VectorXd parameter_direction() const;
    /// The mesh through the nodes of y, for new nodes.
    [[nodiscard]] ShootingMesh mesh_at(const VectorXd& y) const;

    /// The orbit on the plane through a guess across a direction, by Newton's method. Its tangent points to the same
    /// side as the direction.
    /// @param tolerance  of the last step but one (the last one squares it), in the norm.
    /// @param locked     near a branch point: a direction in which the orbit does not move from the guess, along the
    ///                   null vector there. One unknown beta more, F + beta G = 0, keeps the equations regular through
    ///                   the branch point; where they are symmetric beta is zero and the orbit is one.
    [[nodiscard]] Correction corrected(const VectorXd& guess, const VectorXd& direction, double tolerance,
                                       int maximum_iterations, const VectorXd* locked = nullptr) const;

    /// How the orbit at a point moves with further parameters, within the plane across the tangent, and along the
    /// tangent of norm one: shape (size, free.size() + 1). Not finite where two branches meet.
    [[nodiscard]] MatrixXd moves_across(const CurvePoint& point, std::span<const Index> free) const;

    /// Jacobians, residual and multipliers at the point itself; those of Newton's last step belong to where the step
    /// began. Not recomputed where the step was at rounding level, as on located points.
    [[nodiscard]] CurvePoint settled(CurvePoint point) const;

    /// The direction across the tangent in which a second branch leaves a branch point, of norm one. It is the null
    /// vector of the curve's equations bordered by the tangent.
    [[nodiscard]] VectorXd crossing_direction(const CurvePoint& point) const;

private:
    /// Rows of the linear system below the segments' own, for the unknowns (nodes, ln T, parameter / range): the phase
    /// condition and the planes across the directions.
    [[nodiscard]] MatrixXd rows_across(const std::vector<VectorXd>& directions) const;

    const CurveSetting* setting_;
    ShootingMesh mesh_;
    MatrixXd turns_;
    VectorXd scale_;
    std::optional<models::Section> phase_;
    int period_;
    VectorXd weights_;  ///< the norm of y is the Euclidean one of weights * y
    Index n_;
    Index count_;  ///< segments
};

}  // namespace orbid::periodic
