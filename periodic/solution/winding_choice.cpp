#include "periodic/solution/winding_choice.hpp"

#include <cmath>
#include <cstddef>

#include "periodic/orbit/full_turn.hpp"
#include "periodic/solution/closing_equations.hpp"
#include "periodic/solution/guess_correction.hpp"

namespace orbid::periodic {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

/// If the flow of its neighbour misses a node by less than this fraction of a turn, the turn is right. The other one is
/// at least nine times farther away.
constexpr double certain = 0.1;

/// Weight of a linearised closing error of size one beside a correction of size one. The linearisation is not reliable
/// where corrections are large. Of 460 disturbed cycles of the parametric pendulum five get wrong turns with 1e6, which
/// closes it exactly, four with 10, two with 1, none with 0.1 and 0.3.
constexpr double weight = 0.3;

}  // namespace

MatrixXd likely_turns(const ClosingError& closing, const MatrixXd& nearest, const std::vector<Index>& angles,
                      const VectorXd& scale, std::span<const int> rotation) {
    MatrixXd turns = nearest;
    const Index d = closing.error.rows();
    // Rows of the closing error whose turn is open, and in which direction.
    std::vector<Index> rows;
    std::vector<double> directions;
    std::vector<std::size_t> angle;
    for (std::size_t a = 0; a < angles.size(); ++a)
        for (Index j = 0; j < closing.error.cols(); ++j) {
            const double rest = closing.error(angles[a], j) / full_turn - turns(angles[a], j);
            if (!(std::abs(rest) > certain)) continue;
            rows.push_back(d * j + angles[a]);
            directions.push_back(rest > 0.0 ? 1.0 : -1.0);
            angle.push_back(a);
        }
    if (rows.empty()) return turns;

    // The smallest correction costs r^T C r, C = weight (1 - weight J A^-1 J^T), A = 1 + weight J^T J.
    const ClosingEquations equations(closing, scale, weight);
    if (!equations.regular()) return turns;
    const auto open = static_cast<Index>(rows.size());
    MatrixXd change = MatrixXd::Zero(closing.error.size(), open);  // of r by each of the turns
    for (Index k = 0; k < open; ++k) {
        const auto slot = static_cast<std::size_t>(k);
        change(rows[slot], k) = -directions[slot] * full_turn / scale(rows[slot] % d);
    }
    const MatrixXd along = equations.pulled(change);
    const MatrixXd corrections = equations.solve(along);
    const MatrixXd costs = weight * (change.transpose() * change - weight * along.transpose() * corrections);
    const VectorXd r = ((closing.error - full_turn * turns).array().colwise() / scale.array()).matrix().reshaped();
    VectorXd slopes = weight * (change.transpose() * r - weight * corrections.transpose() * equations.pulled(r));
    std::vector<bool> changed(rows.size(), false);
    const auto apply = [&](Index k) {
        const auto slot = static_cast<std::size_t>(k);
        const double sign = changed[slot] ? -1.0 : 1.0;
        slopes += sign * costs.col(k);
        changed[slot] = !changed[slot];
        turns(rows[slot] % d, rows[slot] / d) += sign * directions[slot];
    };
    // Each of the changes goes there and back; the cost falls from step to step, so that this ends.
    for (int step = 0; step < 4 * static_cast<int>(open); ++step) {
        const auto sign = [&](Index k) { return changed[static_cast<std::size_t>(k)] ? -1.0 : 1.0; };
        double best = -1e-9 * costs.trace();
        Index first = -1, second = -1;
        for (Index k = 0; k < open; ++k) {
            const double alone = 2.0 * sign(k) * slopes(k) + costs(k, k);
            if (rotation.empty()) {
                if (alone < best) best = alone, first = k, second = -1;
                continue;
            }
            for (Index l = k + 1; l < open; ++l) {
                const auto one = static_cast<std::size_t>(k), other = static_cast<std::size_t>(l);
                if (angle[one] != angle[other] || sign(k) * directions[one] + sign(l) * directions[other] != 0.0)
                    continue;
                const double both =
                    alone + 2.0 * sign(l) * slopes(l) + costs(l, l) + 2.0 * sign(k) * sign(l) * costs(k, l);
                if (both < best) best = both, first = k, second = l;
            }
        }
        if (first < 0) break;
        apply(first);
        if (second >= 0) apply(second);
    }
    return turns;
}

}  // namespace orbid::periodic
