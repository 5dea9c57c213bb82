#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "periodic/orbit/eigen_names.hpp"
#include "periodic/search/model_section.hpp"

namespace orbid::periodic {

/// Names of the cells of one edge that points of a section lie in. Cells are centred on 0 and, for angles, on half a
/// turn, where the fixed points of a mirror symmetry are. Names are hashes of 64 bits. Two of 10^5 cells collide once
/// in 10^9 times, which costs one start.
class SectionCells {
public:
    /// @param size   shape (n): extent of each coordinate.
    /// @param edge   relative to it, in (0, 0.5].
    /// @param signs  of a symmetry that maps the section onto itself; or empty.
    SectionCells(const models::System& system, VectorXd size, double edge, std::vector<double> signs);

    [[nodiscard]] std::uint64_t name(Eigen::Ref<const VectorXd> x) const { return name(x, false); }
    /// The name of the mirror image; the name itself without a symmetry.
    [[nodiscard]] std::uint64_t mirrored(Eigen::Ref<const VectorXd> x) const { return name(x, true); }

private:
    [[nodiscard]] std::uint64_t name(Eigen::Ref<const VectorXd> x, bool mirrored) const;

    VectorXd size_;
    std::vector<double> signs_;
    std::vector<double> around_;  ///< cells around the circle; 0: no angle
    double edge_;
};

/// One name for a cyclic sequence, whatever its first symbol.
[[nodiscard]] std::uint64_t cyclic_name(const std::uint64_t* symbols, std::size_t count);

/// The same for a cyclic sequence and its mirror image.
[[nodiscard]] std::uint64_t itinerary_name(const SectionCells& cells, const MatrixXd& points);

}  // namespace orbid::periodic
