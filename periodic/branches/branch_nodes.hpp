#pragma once

#include <Eigen/Core>

#include "periodic/branches/branch_curve.hpp"

namespace orbid::periodic {

/// Cosine between the flow at the first node of an autonomous orbit and the normal of its phase condition.
[[nodiscard]] double phase_cosine(const CurvePoint& point);

/// Unit of each coordinate along a mesh: the one asked for, or 2 pi for angles and the largest value in between the
/// nodes for the others. Shape (n).
[[nodiscard]] Eigen::VectorXd scale_along(const CurveSetting& setting, const ShootingMesh& mesh);

/// The same orbit with further nodes where errors grow too much in between, a phase condition across the flow where the
/// old one has become oblique, and a larger scale where it has grown beyond the old one; the point itself when nothing
/// was to be done, or could be.
[[nodiscard]] CurvePoint with_fitting_nodes(const CurvePoint& point);

}  // namespace orbid::periodic
