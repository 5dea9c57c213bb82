#pragma once

#include <Eigen/Core>

#include "orbits/sections/neighbour_index.hpp"
#include "orbits/sections/section_points.hpp"

namespace orbid::orbits {

/// From every point of a section to its image, without the jumps of angles read in one turn.
struct SectionLift {
    Eigen::MatrixXd displacement;  ///< shape (n, points), scaled units, angles in turns; nan without an image
    /// Shape (n): with a symmetry D(S x) - offset = S (D(x) - offset) holds; halves of whole turns. Else 0.
    Eigen::VectorXd offset;
    double residual = 0.0;  ///< rms of local linear fits to the lifted angles' displacements, turns; 0 without angles
};

/// From every point to its image as read, angles the short way round unless the section counts turns: shape
/// (n, points), scaled units; nan without an image.
[[nodiscard]] Eigen::MatrixXd displacements_as_read(const SectionPoints& section);

/// Continuous displacement D(x) = F(x) - x of the angles over the section.
///
/// An angle's image is known up to whole turns. Linear fits on the k nearest neighbours (turns chosen anew at every
/// fit) are joined along the tree of neighbours that agree best. The turns of a fit continue its parent's. Where images
/// of neighbours scatter over half a turn a tree may take a wrong branch. Trees of several k are therefore grown, and
/// the one whose lifted displacements fit best locally is kept. Pieces of the section without connecting neighbours are
/// lifted separately. Nothing to do without angles, or if the series counts turns itself.
///
/// Cost: O(points k).
[[nodiscard]] SectionLift lift_section(const SectionPoints& section, const NeighbourIndex& grid);

}  // namespace orbid::orbits
