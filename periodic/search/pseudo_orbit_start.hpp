#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "periodic/orbit/eigen_names.hpp"
#include "periodic/search/model_section.hpp"
#include "periodic/search/section_cell.hpp"

namespace orbid::periodic {

/// Cyclic sequences of p cells with observed transitions: pieces of trajectories joined where they pass through the
/// same cell. An orbit all of whose transitions were observed is within a cell of one of these at every point. A
/// recurrence, in contrast, needs a trajectory that stays near the orbit for a whole round.
class PseudoOrbits {
public:
    /// Cost: O(points log points).
    PseudoOrbits(const SectionPieces& pieces, const SectionCells& cells);

    /// All of one length, in an order that mixes them. Each occurs once whatever its first cell and, with a symmetry,
    /// mirrored or not. None when there are more than `most`: counting then stopped there.
    [[nodiscard]] std::optional<std::vector<std::vector<std::uint32_t>>> loops(int period, std::size_t most) const;

    /// One observed state in each cell of a loop, on its way to the next. Shape (n, p).
    [[nodiscard]] MatrixXd points(const std::vector<std::uint32_t>& loop) const;

private:
    struct Step {
        std::uint32_t to;
        std::uint32_t piece;
        Index column;
    };

    const SectionPieces& pieces_;
    std::vector<std::vector<Step>> steps_;  ///< by cell, in the order of `to`
    std::vector<std::uint64_t> names_;      ///< of the cells
    std::vector<std::uint64_t> mirrored_;
};

}  // namespace orbid::periodic
