#pragma once

#include <span>
#include <vector>

#include "models/system/system.hpp"
#include "periodic/orbit/eigen_names.hpp"

namespace orbid::periodic {

/// Indices of the coordinates that are angles.
[[nodiscard]] std::vector<Index> angle_coordinates(const models::System& system);

/// 2 pi for angles, the largest |guess| for the others. System::state_size() where that is zero, or a rounded zero
/// beside it or the largest coordinate. Shape (n).
[[nodiscard]] VectorXd default_scale(const models::System& system, const MatrixXd& guess);

/// Whole turns from each node to the next: the nearest ones for the flow of the guess. Where the wanted total differs,
/// the segments with the least certain turns are changed, by one turn each.
///
/// @param error     shape (n, N): flow of each node - next node.
/// @param rotation  wanted turns per angle, or empty.
/// @return whole numbers, shape (n, N), zero but for angles.
[[nodiscard]] MatrixXd winding_numbers(const MatrixXd& error, const std::vector<Index>& angles,
                                       std::span<const int> rotation);

/// Whole turns of the orbit, one sum per angle.
[[nodiscard]] std::vector<int> total_rotation(const MatrixXd& turns, const std::vector<Index>& angles);

/// How often the points of a closed orbit run through the same ones, within a fraction `same` of the scale: 1 where the
/// prime period is p. Different points of a converged orbit are closer only next to a period doubling, where the orbits
/// cannot be distinguished either.
[[nodiscard]] int repeats_of(const MatrixXd& points, const std::vector<Index>& angles, const VectorXd& scale,
                             double same = 1e-7);

/// The points of a closed orbit in the order that begins with a later one.
[[nodiscard]] MatrixXd begun_later(const MatrixXd& points, Index first);

/// Largest element relative to the scale of its row.
[[nodiscard]] double relative_size(const MatrixXd& difference, const VectorXd& scale);

/// Differences of states, in (-pi, pi] for angles. Shape (n, m).
[[nodiscard]] MatrixXd wrapped_angles(MatrixXd difference, const std::vector<Index>& angles);

}  // namespace orbid::periodic
