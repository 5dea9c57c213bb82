#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include <Eigen/Core>

#include "periodic/search/model_section.hpp"
#include "periodic/search/section_cell.hpp"

namespace orbid::periodic {

/// Cyclic sequences of p cells each of which was seen to lead to the next: pieces of trajectories joined where they
/// pass through the same cell. An orbit all of whose steps have been seen is within a cell of one of these at every
/// point, while a recurrence needs a trajectory that stays near the orbit for a whole turn.
class PseudoOrbits {
public:
    /// Cost: O(points log points).
    PseudoOrbits(const SectionPieces& pieces, const SectionCells& cells);

    /// All of them of one length, each once whatever its first cell and, with a symmetry, mirrored or not; in an order
    /// that mixes them. None when there are more than `most`: smaller ones were then only counted up to there.
    [[nodiscard]] std::optional<std::vector<std::vector<std::uint32_t>>> loops(int period, std::size_t most) const;

    /// One state seen in each cell of a loop, on its way to the next. Shape (n, p).
    [[nodiscard]] Eigen::MatrixXd points(const std::vector<std::uint32_t>& loop) const;

private:
    struct Step {
        std::uint32_t to;
        std::uint32_t piece;
        Eigen::Index column;
    };

    const SectionPieces& pieces_;
    std::vector<std::vector<Step>> steps_;  ///< by cell, in the order of `to`
    std::vector<std::uint64_t> names_;      ///< of the cells
    std::vector<std::uint64_t> mirrored_;
};

}  // namespace orbid::periodic
