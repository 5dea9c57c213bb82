#pragma once

#include "periodic/branches/branch_curve.hpp"
#include "periodic/orbit/eigen_names.hpp"

namespace orbid::periodic {

/// Cosine between the flow at the first node of an autonomous orbit and the normal of its phase condition.
[[nodiscard]] double phase_cosine(const CurvePoint& point);

/// The plane through a state across the flow there.
[[nodiscard]] models::Section plane_across_flow(const models::System& system, const VectorXd& theta, const VectorXd& x);

/// Unit of each coordinate along a mesh: the one asked for. Otherwise 2 pi for angles and the largest value between the
/// nodes for the others. Shape (n).
[[nodiscard]] VectorXd scale_along(const CurveSetting& setting, const ShootingMesh& mesh);

/// The same orbit, adapted where needed. It gets further nodes where errors grow too much between two. It gets a phase
/// condition across the flow if the old one is oblique, and a larger scale if it has outgrown the old one. The point
/// itself when nothing had to be done, or could be.
[[nodiscard]] CurvePoint with_fitting_nodes(const CurvePoint& point);

}  // namespace orbid::periodic
