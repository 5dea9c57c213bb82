#pragma once

#include <optional>
#include <vector>

#include "periodic/branches/branch_curve.hpp"

namespace orbid::periodic {

/// A curve of twice the period at a period doubling, and the first orbit on it.
struct BranchSwitch {
    CurvePoint origin;  ///< the orbit of the bifurcation on the new curve, its tangent along the new branch
    CurvePoint first;   ///< an orbit on the new branch, its tangent away from the bifurcation
};

/// The branch of twice the period that begins at a doubling. Its direction there is the eigenvector for -1, v on the
/// first half and -v on the second, at a fixed parameter. The other direction leads to the same orbits, begun a period
/// later.
/// @param step  distance of the first orbit from the bifurcation; shortened when no orbit is found there.
[[nodiscard]] std::optional<BranchSwitch> doubled(const CurvePoint& point, double step, double smallest_step);

/// The branches that cross at a branch point: one for each direction in which an orbit is found, two at most. A model
/// that declares a symmetry has the second one as the mirror image of the first; it is then omitted.
[[nodiscard]] std::vector<BranchSwitch> crossing(const CurvePoint& point, double step, double smallest_step);

}  // namespace orbid::periodic
