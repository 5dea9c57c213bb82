#include "periodic/branches/branch_nodes.hpp"

#include <cmath>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "periodic/discretisation/shooting_steps.hpp"
#include "periodic/orbit/winding_number.hpp"

namespace orbid::periodic {

double phase_cosine(const CurvePoint& point) {
    const CurveSetting& setting = point.curve->setting();
    const VectorXd f = setting.system.rhs(point.curve->nodes(point.y).col(0), std::vector<double>{0.0},
                                          setting.theta_at(point.parameter()));
    const VectorXd& normal = point.curve->phase()->normal;
    return normal.dot(f) / (normal.norm() * f.norm());
}

models::Section plane_across_flow(const models::System& system, const VectorXd& theta, const VectorXd& x) {
    const VectorXd f = system.rhs(x, std::vector<double>{0.0}, theta);
    return {f, f.dot(x)};
}

VectorXd scale_along(const CurveSetting& setting, const ShootingMesh& mesh) {
    if (setting.solver.scale.size() > 0) return setting.solver.scale;
    constexpr int instants = 16;  // of a segment: an extremum between them is missed by a few per cent
    MatrixXd values = mesh.nodes;
    for (std::size_t j = 0; j < mesh.segments.size() && setting.system.kind() != models::Kind::map; ++j) {
        std::vector<double> durations;
        for (int k = 1; k < instants; ++k)
            durations.push_back(mesh.segments[j].duration * k / instants);
        const auto flow = setting.system.flow(mesh.nodes.col(static_cast<Index>(j)), mesh.segments[j].phase, durations,
                                              setting.theta, mesh.clock, setting.solver.flow);
        if (flow.status != models::FlowStatus::ok) continue;
        const Index known = values.cols();
        values.conservativeResize(Eigen::NoChange, known + flow.states.cols());
        values.rightCols(flow.states.cols()) = flow.states;
    }
    return default_scale(setting.system, values);
}

namespace {

/// The same tangent where the orbit begins on another plane: all nodes move along the flow by one time, so that the
/// first one moves within the plane. Without that, a tangent that is mostly along the flow may come out reversed.
VectorXd moved_along_flow(const CurvePoint& point, const models::Section& plane) {
    const CurveSetting& setting = point.curve->setting();
    const MatrixXd nodes = point.curve->nodes(point.y);
    const VectorXd theta = setting.theta_at(point.parameter());
    const Index n = nodes.rows();
    MatrixXd flow(n, nodes.cols());
    for (Index j = 0; j < nodes.cols(); ++j)
        flow.col(j) = setting.system.rhs(nodes.col(j), std::vector<double>{0.0}, theta);
    VectorXd moved = point.tangent;
    const double time = plane.normal.dot(moved.head(n)) / plane.normal.dot(flow.col(0));
    moved.head(flow.size()) -= time * flow.reshaped();
    return moved;
}

}  // namespace

CurvePoint with_fitting_nodes(const CurvePoint& point) {
    const OrbitCurve& old = *point.curve;
    const CurveSetting& setting = old.setting();
    const bool grows = grows_too_much(setting.system, point.jacobians, setting.solver);
    const bool oblique = old.autonomous() && std::abs(phase_cosine(point)) < 0.7;
    // Nodes may exceed the scale this many times before it is enlarged.
    constexpr double most_growth_of_scale = 3.0;
    VectorXd scale = old.scale();
    if (setting.solver.scale.size() == 0) {
        const VectorXd now = default_scale(setting.system, old.nodes(point.y));
        for (Index i = 0; i < scale.size(); ++i)
            if (now(i) > most_growth_of_scale * scale(i)) scale(i) = now(i);
    }
    if (!grows && !oblique && scale == old.scale()) return point;
    ShootingMesh mesh = old.mesh_at(point.y);
    MatrixXd turns = old.turns();
    std::optional<models::Section> phase = old.phase();
    const VectorXd theta = setting.theta_at(point.parameter());
    // The old tangent where nodes stay; none at new ones.
    VectorXd direction = point.tangent;
    if (oblique) {
        phase = plane_across_flow(setting.system, theta, mesh.nodes.col(0));
        direction = moved_along_flow(point, *phase);
    }
    if (grows) {
        ShootingMesh finer = refined(setting.system, theta, mesh, setting.solver.segment_growth, setting.solver.flow);
        const auto closing =
            closing_error(FlowSteps(setting.system, theta, finer, setting.solver.flow), finer.nodes, finer.time);
        if (!closing.simulated) return point;
        turns = winding_numbers(closing.error, angle_coordinates(setting.system), {});
        const Index n = finer.nodes.rows();
        const Index extra = direction.size() - n * mesh.nodes.cols();
        VectorXd lifted = VectorXd::Zero(finer.nodes.size() + extra);
        Index next = 0;
        for (Index j = 0; j < finer.nodes.cols() && next < mesh.nodes.cols(); ++j)
            if (finer.nodes.col(j) == mesh.nodes.col(next)) lifted.segment(n * j, n) = direction.segment(n * next++, n);
        lifted.tail(extra) = direction.tail(extra);
        direction = lifted;
        mesh = std::move(finer);
    }
    const auto curve = std::make_shared<const OrbitCurve>(setting, std::move(mesh), turns, scale, phase, old.period());
    const Correction moved =
        curve->corrected(curve->at_mesh(point.parameter()), direction, setting.solver.tolerance, 12);
    return moved.status == OrbitStatus::converged ? moved.point : point;
}

}  // namespace orbid::periodic
