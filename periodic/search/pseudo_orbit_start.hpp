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
    /// @param angles  coordinates that are angles.
    /// Cost: O(points log points).
    PseudoOrbits(const SectionPieces& pieces, const SectionCells& cells, std::vector<Index> angles);

    /// All of one length, in an order that mixes them. Each occurs once whatever its first cell and, with a symmetry,
    /// mirrored or not. None when there are more than `most`: counting then stopped there.
    [[nodiscard]] std::optional<std::vector<std::vector<std::uint32_t>>> loops(int period, std::size_t most) const;

    /// Observed states in the cells of a loop, each on its way to the next cell, shape (n, p) each. One for every state
    /// compared in the first cell, the others chosen so that the squares of the jumps have the least sum; least sums
    /// first, `most` of them.
    [[nodiscard]] std::vector<MatrixXd> starts(const std::vector<std::uint32_t>& loop, std::size_t most) const;

private:
    struct SeenStep {
        std::uint32_t piece;
        std::uint32_t column;
    };
    /// All steps from one cell to another.
    struct Step {
        std::uint32_t to;
        std::size_t begin, end;  ///< in seen_
    };

    /// Observed steps from one cell to another, at most as many as are compared.
    [[nodiscard]] std::vector<SeenStep> candidates(std::uint32_t from, std::uint32_t to) const;
    [[nodiscard]] auto state(const SeenStep& step, Index later) const {
        return pieces_.pieces[step.piece].col(static_cast<Index>(step.column) + later);
    }
    /// Squares of the jumps from the end of each step to the state of each of the next cell's, relative to the size.
    [[nodiscard]] MatrixXd jumps(const std::vector<SeenStep>& steps, const std::vector<SeenStep>& next) const;

    const SectionPieces& pieces_;
    std::vector<Index> angles_;
    std::vector<SeenStep> seen_;            ///< by both cells, then in the order of the pieces
    std::vector<std::vector<Step>> steps_;  ///< by cell, in the order of `to`
    std::vector<std::uint64_t> names_;      ///< of the cells
    std::vector<std::uint64_t> mirrored_;
};

}  // namespace orbid::periodic
