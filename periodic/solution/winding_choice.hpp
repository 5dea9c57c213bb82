#pragma once

#include <span>
#include <vector>

#include "periodic/discretisation/closing_error.hpp"
#include "periodic/orbit/eigen_names.hpp"

namespace orbid::periodic {

/// Whole turns between the nodes of a guess, chosen for the smallest correction of the guess. With r the closing error
/// for some turns and J its derivative, both in units of the scales, the turns with the smallest
///
///     min_d |d|^2 + mu |J d + r|^2.
///
/// The turns nearest to the flow of the guess are wrong where errors have grown to a third of a turn or more. The
/// resulting correction is then too large, as it must turn the orbit by the rest. The search changes the turn of one
/// node, or of two if a rotation is given, as long as that makes the correction smaller.
///
/// @param closing   at the guess, turns not taken off.
/// @param nearest   turns to begin with, shape of closing.error (see winding_numbers()).
/// @param scale     typical size of each coordinate.
/// @param rotation  if not empty, the sum of the turns is kept.
[[nodiscard]] MatrixXd likely_turns(const ClosingError& closing, const MatrixXd& nearest,
                                    const std::vector<Index>& angles, const VectorXd& scale,
                                    std::span<const int> rotation);

}  // namespace orbid::periodic
