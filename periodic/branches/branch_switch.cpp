#include "periodic/branches/branch_switch.hpp"

#include <memory>
#include <utility>

#include "periodic/branches/bifurcation_point.hpp"
#include "periodic/branches/branch_report.hpp"
#include "periodic/stability/floquet_vector.hpp"

namespace orbid::periodic {
namespace {

constexpr int switch_newton_steps = 10;

/// A first orbit farther from its prediction than this fraction of the step is rejected. The direction of a doubled
/// branch is known; a crossing branch lies anywhere across the known one, in steep cases at this slope.
constexpr double switch_distance = 0.5;
constexpr double largest_slope = 4.0;

/// Nor may a multiplier have moved by more than this: the next bifurcation may follow soon.
constexpr double switch_move = 0.5;

/// The first orbit of a branch is looked for at this many times shorter and shorter steps.
constexpr double shortening = 0.25;

/// An orbit at a given distance from a bifurcation, in a direction.
std::optional<CurvePoint> first_orbit(const CurvePoint& origin, const VectorXd& direction, double step,
                                      double smallest_step, double most_distant) {
    const OrbitCurve& curve = *origin.curve;
    for (double length = step; length >= smallest_step; length *= shortening) {
        Correction correction = curve.corrected(origin.y + length * direction, direction,
                                                curve.setting().solver.tolerance, switch_newton_steps);
        if (correction.status != OrbitStatus::converged || !(correction.distance <= most_distant * length)) continue;
        if (largest_multiplier_move(origin, correction.point) > switch_move && length * shortening >= smallest_step)
            continue;
        return std::move(correction.point);
    }
    return std::nullopt;
}

}  // namespace

std::optional<BranchSwitch> doubled(const CurvePoint& point, double step, double smallest_step) {
    const OrbitCurve& old = *point.curve;
    const CurveSetting& setting = old.setting();
    const ShootingMesh once = old.mesh_at(point.y);
    const Index n = once.nodes.rows();
    const Index count = once.nodes.cols();

    ShootingMesh twice = once;
    twice.nodes = once.nodes.replicate(1, 2);
    twice.time *= 2.0;
    twice.segments.insert(twice.segments.end(), once.segments.begin(), once.segments.end());
    for (Segment& segment : twice.segments)
        segment.share *= 0.5;
    for (const Index index : once.points)
        twice.points.push_back(index + count);
    const auto curve = std::make_shared<const OrbitCurve>(setting, std::move(twice), old.turns().replicate(1, 2),
                                                          old.scale(), old.phase(), 2 * old.period());

    const FloquetVectors vectors = floquet_vectors(point.jacobians, -1.0);
    MatrixXd v = vectors.right.real();
    // floquet_vectors() spreads the sign over the orbit in its first factor: v_1 = -X_0 v_0 there, v_1 = X_0 v_0 here.
    v.rightCols(count - 1) = -v.rightCols(count - 1);
    MatrixXd second = -v;
    if (old.autonomous()) {
        // A shift along the orbit is the same on both halves; the phase condition fixes it.
        const std::vector<double> no_phases(static_cast<std::size_t>(count), 0.0);
        const MatrixXd f = setting.system.rhs(once.nodes, no_phases, setting.theta_at(point.parameter()));
        const VectorXd& normal = old.phase()->normal;
        const MatrixXd shift = -normal.dot(v.col(0)) / normal.dot(f.col(0)) * f;
        v += shift;
        second += shift;
    }
    VectorXd direction = VectorXd::Zero(curve->size());
    direction.head(n * count) = v.reshaped();
    direction.segment(n * count, n * count) = second.reshaped();
    direction /= curve->norm(direction);

    // The orbit twice over. It is not solved for again: there the matrix of the new curve is singular.
    BranchSwitch result{point, {}};
    CurvePoint& origin = result.origin;
    origin.curve = curve;
    origin.y = curve->at_mesh(point.parameter());
    origin.tangent = direction;
    origin.jacobians.insert(origin.jacobians.end(), point.jacobians.begin(), point.jacobians.end());
    origin.columns = point.columns.replicate(2, 1);
    if (old.autonomous()) origin.columns.col(0) *= 0.5;
    for (auto& multiplier : origin.multipliers)
        multiplier *= multiplier;
    auto first = first_orbit(result.origin, direction, step, smallest_step, switch_distance);
    if (!first) return std::nullopt;
    result.first = std::move(*first);
    return result;
}

std::vector<BranchSwitch> crossing(const CurvePoint& point, double step, double smallest_step) {
    std::vector<BranchSwitch> result;
    const VectorXd direction = point.curve->crossing_direction(point);
    if (!direction.allFinite()) return result;
    for (const double sign : {1.0, -1.0}) {
        BranchSwitch branch{point, {}};
        branch.origin.tangent = sign * direction;
        const double length =
            result.empty() ? step : point.curve->norm(result.front().first.y - result.front().origin.y);
        auto first = first_orbit(branch.origin, branch.origin.tangent, length, smallest_step, largest_slope);
        if (!first) continue;
        branch.first = std::move(*first);
        // Other branches differ by as much as they are away from the branch point; mirror images only by the error of
        // the direction.
        if (!result.empty() && mirror_images(result.front().first, branch.first, 0.1 * length)) continue;
        result.push_back(std::move(branch));
    }
    return result;
}

}  // namespace orbid::periodic
