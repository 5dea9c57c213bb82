#pragma once

#include <string>
#include <vector>

#include <Eigen/Core>

#include "identification/problem/structural_report.hpp"

namespace orbid::identification {

/// Directions without effect at one course of one draw of parameters: those of the shared unknowns, and what the first
/// state of the course has to do along them.
struct NullSpace {
    Eigen::MatrixXd directions;  ///< shape (shared + coordinates, any), in the unknowns' own units
    Eigen::VectorXd values;      ///< shape (shared + coordinates): of the unknowns there
};

/// The directions by name: scalings first, then shifts, then other combinations.
///
/// A scaling has the same components in the logarithms of the unknowns at every course, a shift the same in the
/// unknowns themselves. One shared unknown is held for each direction: the last that leaves the others determined.
///
/// @param spaces  at least one, all with the same number of directions
/// @param names   of the shared unknowns, then of the coordinates
/// @param shared  number of shared unknowns
[[nodiscard]] std::vector<UndeterminedDirection> named_directions(const std::vector<NullSpace>& spaces,
                                                                  const std::vector<std::string>& names,
                                                                  Eigen::Index shared);

}  // namespace orbid::identification
