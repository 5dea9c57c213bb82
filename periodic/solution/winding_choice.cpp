#include "periodic/solution/winding_choice.hpp"

#include <cmath>
#include <cstddef>
#include <utility>

#include "periodic/orbit/full_turn.hpp"
#include "periodic/solution/closing_equations.hpp"
#include "periodic/solution/guess_correction.hpp"

namespace orbid::periodic {

namespace {

/// If the flow of its neighbour misses a node by less than this fraction of a turn, the turn is right. The other one is
/// at least nine times farther away.
constexpr double certain = 0.1;

/// Weight of a linearised closing error of size one beside a correction of size one. The linearisation is not reliable
/// where corrections are large. Of 460 disturbed cycles of the parametric pendulum five get wrong turns with 1e6, which
/// closes it exactly, four with 10, two with 1, none with 0.1 and 0.3.
constexpr double weight = 0.3;

/// Entries of the closing error whose turn is open.
struct OpenTurns {
    std::vector<Index> rows;
    std::vector<double> directions;  ///< of the other turn
    std::vector<std::size_t> angle;
};

OpenTurns open_turns(const ClosingError& closing, const MatrixXd& turns, const std::vector<Index>& angles) {
    OpenTurns open;
    for (std::size_t a = 0; a < angles.size(); ++a)
        for (Index j = 0; j < closing.error.cols(); ++j) {
            const double rest = closing.error(angles[a], j) / full_turn - turns(angles[a], j);
            if (!(std::abs(rest) > certain)) continue;
            open.rows.push_back(closing.error.rows() * j + angles[a]);
            open.directions.push_back(rest > 0.0 ? 1.0 : -1.0);
            open.angle.push_back(a);
        }
    return open;
}

/// What changing open turns, each there and back, does to the cost of the smallest correction.
struct TurnChanges {
    MatrixXd costs;
    VectorXd slopes;
    std::vector<bool> changed;

    [[nodiscard]] double sign(Index k) const { return changed[static_cast<std::size_t>(k)] ? -1.0 : 1.0; }
};

/// The smallest correction costs r^T C r, C = weight (1 - weight J A^-1 J^T), A = 1 + weight J^T J.
TurnChanges turn_changes(const ClosingError& closing, const ClosingEquations& equations, const MatrixXd& turns,
                         const OpenTurns& open, const VectorXd& scale) {
    const auto count = static_cast<Index>(open.rows.size());
    MatrixXd change = MatrixXd::Zero(closing.error.size(), count);  // of r by each of the turns
    for (Index k = 0; k < count; ++k) {
        const auto slot = static_cast<std::size_t>(k);
        change(open.rows[slot], k) = -open.directions[slot] * full_turn / scale(open.rows[slot] % closing.error.rows());
    }
    const MatrixXd along = equations.pulled(change);
    const MatrixXd corrections = equations.solve(along);
    const VectorXd r = ((closing.error - full_turn * turns).array().colwise() / scale.array()).matrix().reshaped();
    return {weight * (change.transpose() * change - weight * along.transpose() * corrections),
            weight * (change.transpose() * r - weight * corrections.transpose() * equations.pulled(r)),
            std::vector<bool>(open.rows.size(), false)};
}

/// The change that lowers the cost most, or the two that do and keep the rotation; -1: none.
std::pair<Index, Index> best_change(const OpenTurns& open, const TurnChanges& changes, bool keep_rotation) {
    const MatrixXd& costs = changes.costs;
    const VectorXd& slopes = changes.slopes;
    double best = -1e-9 * costs.trace();
    Index first = -1, second = -1;
    for (Index k = 0; k < slopes.size(); ++k) {
        const double alone = 2.0 * changes.sign(k) * slopes(k) + costs(k, k);
        if (!keep_rotation) {
            if (alone < best) best = alone, first = k, second = -1;
            continue;
        }
        for (Index l = k + 1; l < slopes.size(); ++l) {
            const auto one = static_cast<std::size_t>(k), other = static_cast<std::size_t>(l);
            if (open.angle[one] != open.angle[other] ||
                changes.sign(k) * open.directions[one] + changes.sign(l) * open.directions[other] != 0.0)
                continue;
            const double both = alone + 2.0 * changes.sign(l) * slopes(l) + costs(l, l) +
                                2.0 * changes.sign(k) * changes.sign(l) * costs(k, l);
            if (both < best) best = both, first = k, second = l;
        }
    }
    return {first, second};
}

}  // namespace

MatrixXd likely_turns(const ClosingError& closing, const MatrixXd& nearest, const std::vector<Index>& angles,
                      const VectorXd& scale, std::span<const int> rotation) {
    MatrixXd turns = nearest;
    const OpenTurns open = open_turns(closing, turns, angles);
    if (open.rows.empty()) return turns;
    const ClosingEquations equations(closing, scale, weight);
    if (!equations.regular()) return turns;
    TurnChanges changes = turn_changes(closing, equations, turns, open, scale);
    const Index d = closing.error.rows();
    const auto apply = [&](Index k) {
        const auto slot = static_cast<std::size_t>(k);
        const double sign = changes.sign(k);
        changes.slopes += sign * changes.costs.col(k);
        changes.changed[slot] = !changes.changed[slot];
        turns(open.rows[slot] % d, open.rows[slot] / d) += sign * open.directions[slot];
    };
    // Each of the changes goes there and back; the cost falls from step to step, so that this ends.
    for (int step = 0; step < 4 * static_cast<int>(open.rows.size()); ++step) {
        const auto [first, second] = best_change(open, changes, !rotation.empty());
        if (first < 0) break;
        apply(first);
        if (second >= 0) apply(second);
    }
    return turns;
}

}  // namespace orbid::periodic
