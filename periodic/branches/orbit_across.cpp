#include "periodic/branches/orbit_across.hpp"

#include <algorithm>
#include <cassert>
#include <memory>
#include <optional>
#include <utility>

#include "periodic/branches/branch_curve.hpp"
#include "periodic/branches/branch_nodes.hpp"
#include "periodic/branches/branch_report.hpp"
#include "periodic/discretisation/shooting_steps.hpp"
#include "periodic/orbit/winding_number.hpp"

namespace orbid::periodic {
namespace {

/// The direction at all nodes of a curve: those that are no points of the start do not count.
VectorXd direction_of_nodes(const OrbitCurve& curve, const BranchDirection& direction) {
    const Index n = curve.scale().size();
    VectorXd y = VectorXd::Zero(curve.size());
    const auto& points = curve.mesh().points;
    const Index known = std::min(direction.points.cols(), std::ssize(points));
    for (Index k = 0; k < known; ++k)
        y.segment(n * points[static_cast<std::size_t>(k)], n) = direction.points.col(k);
    if (curve.autonomous()) y(y.size() - 2) = direction.ln_time;
    y(y.size() - 1) = direction.parameter;
    return y;
}

/// Columns of y in the order of an orbit's points.
void take_columns(BranchOrbit& result, const OrbitCurve& curve, const MatrixXd& moves) {
    const Index n = curve.scale().size();
    PeriodicOrbit& orbit = result.orbit;
    const Index count = orbit.points.cols();
    orbit.sensitivities.resize(n * count, moves.cols());
    for (Index k = 0; k < count; ++k) {
        const Index node = curve.autonomous() ? k : curve.mesh().points[static_cast<std::size_t>(k)];
        orbit.sensitivities.middleRows(n * k, n) = moves.middleRows(n * node, n);
    }
    if (curve.autonomous()) orbit.time_sensitivities = orbit.time * moves.row(moves.rows() - 2);
    result.parameter_sensitivities = moves.bottomRows(1);
}

}  // namespace

BranchOrbit orbit_across(const models::System& system, const VectorXd& theta, Index parameter, double range,
                         const StartingSolution& start, const BranchDirection& direction, std::span<const Index> free,
                         const ShootingOptions& options) {
    assert(system.kind() != models::Kind::map && !start.section);
    BranchOrbit result;
    result.orbit.status = OrbitStatus::not_simulated;
    const CurveSetting setting{system, theta, parameter, range, start.phase, std::nullopt, options};
    ShootingMesh mesh = mesh_from_guess(system, theta, start, options.flow);
    if (!mesh.simulated) return result;
    const ClosingError closing = refine_and_close(system, theta, mesh, options);
    if (!closing.simulated) return result;
    std::optional<models::Section> phase;
    if (system.kind() == models::Kind::autonomous) phase = plane_across_flow(system, theta, mesh.nodes.col(0));
    const MatrixXd turns = winding_numbers(closing.error, angle_coordinates(system), start.rotation);
    const VectorXd scale = scale_along(setting, mesh);
    const int period = phase ? 1 : static_cast<int>(start.points.cols());
    const auto curve = std::make_shared<const OrbitCurve>(setting, std::move(mesh), turns, scale, phase, period);
    const Correction correction =
        curve->corrected(curve->at_mesh(theta(parameter)), direction_of_nodes(*curve, direction), options.tolerance,
                         options.maximum_iterations);
    result.orbit.status = correction.status;
    if (correction.status != OrbitStatus::converged) return result;
    const MatrixXd moves = curve->moves_across(correction.point, free);
    if (!moves.allFinite()) {
        result.orbit.status = OrbitStatus::singular;
        return result;
    }
    result.orbit = reported(correction.point);
    result.orbit.distance = correction.distance;
    result.parameter = correction.point.parameter();
    take_columns(result, *curve, moves);
    return result;
}

}  // namespace orbid::periodic
