#include "periodic/branches/branch_report.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <numbers>
#include <optional>
#include <vector>

#include "periodic/orbit/winding_number.hpp"
#include "periodic/solution/orbit_report.hpp"

namespace orbid::periodic {
namespace {

/// Crossings nearer to each other than this fraction of T are one, seen from both sides of a node.
constexpr double same_crossing = 1e-9;

struct Crossings {
    MatrixXd states;
    VectorXd times;
};

/// All crossings of a plane by an autonomous orbit, segment by segment so that no error grows.
Crossings crossings_of(const CurvePoint& point, const models::Section& section) {
    const CurveSetting& setting = point.curve->setting();
    const ShootingMesh mesh = point.curve->mesh_at(point.y);
    const VectorXd theta = setting.theta_at(point.parameter());
    std::vector<VectorXd> states;
    std::vector<double> times;
    double begin = 0.0;
    // A node that lies on the plane crosses it at its own instant, which a start does not count as.
    const auto note = [&](double time, const VectorXd& state) {
        for (const double known : times)
            if (std::abs(known - time) < same_crossing * mesh.time ||
                std::abs(std::abs(known - time) - mesh.time) < same_crossing * mesh.time)
                return;
        times.push_back(time);
        states.push_back(state);
    };
    for (std::size_t j = 0; j < mesh.segments.size(); ++j) {
        const VectorXd x = mesh.nodes.col(static_cast<Index>(j));
        const double duration = mesh.segments[j].duration;
        const VectorXd f = setting.system.rhs(x, std::vector<double>{0.0}, theta);
        const double gap = section.normal.dot(x) - section.offset;
        const double speed = section.normal.dot(f);
        if (std::abs(gap) <= same_crossing * mesh.time * std::abs(speed) && speed * section.direction > 0.0)
            note(begin, x);
        // One at a time: the flow ends with the segment, however soon another crossing would follow.
        constexpr int most = 1000;  // only keeps the list finite
        VectorXd from = x;
        double at = 0.0;
        for (int k = 0; k < most; ++k) {
            const double left = duration * (1.0 + same_crossing) - at;
            if (!(left > 0.0)) break;
            const auto found =
                setting.system.crossings(from, section, 1, left, theta, std::nullopt, setting.solver.flow);
            if (found.times.size() == 0) break;
            at += found.times(0);
            from = found.states.col(0);
            note(begin + at, from);
        }
        begin += duration;
    }
    Crossings result{MatrixXd(point.curve->nodes(point.y).rows(), static_cast<Index>(states.size())),
                     Eigen::Map<const VectorXd>(times.data(), std::ssize(times))};
    for (std::size_t k = 0; k < states.size(); ++k)
        result.states.col(static_cast<Index>(k)) = states[k];
    return result;
}

/// One point per period, not wrapped.
MatrixXd section_points(const CurvePoint& point) {
    const MatrixXd nodes = point.curve->nodes(point.y);
    const std::vector<Index>& wanted = point.curve->mesh().points;
    MatrixXd points(nodes.rows(), static_cast<Index>(wanted.size()));
    for (std::size_t k = 0; k < wanted.size(); ++k)
        points.col(static_cast<Index>(k)) = nodes.col(wanted[k]);
    return points;
}

double distance(const MatrixXd& difference, const OrbitCurve& curve) {
    return relative_size(wrapped_angles(difference, angle_coordinates(curve.setting().system)), curve.scale());
}

/// Where an autonomous orbit comes near a state, as fractions of T, and how near: local minima among samples, each
/// improved along the flow.
struct Approach {
    double share;
    double distance;
};

std::vector<Approach> approaches(const CurvePoint& point, const VectorXd& x) {
    // A state on the orbit is at most half an instant away from a sample, where the flow is almost straight.
    constexpr int instants = 64;
    constexpr int most_improvements = 8;
    const CurveSetting& setting = point.curve->setting();
    const ShootingMesh mesh = point.curve->mesh_at(point.y);
    const VectorXd theta = setting.theta_at(point.parameter());
    const std::vector<Index> angles = angle_coordinates(setting.system);
    const auto gap = [&](const VectorXd& state) { return VectorXd(wrapped_angles(x - state, angles)); };
    std::vector<VectorXd> states;
    std::vector<double> shares;
    std::vector<double> gaps;
    double begin = 0.0;
    for (std::size_t s = 0; s < mesh.segments.size(); ++s) {
        std::vector<double> durations;
        for (int k = 0; k < instants; ++k)
            durations.push_back(mesh.segments[s].duration * k / instants);
        const auto flow = setting.system.flow(mesh.nodes.col(static_cast<Index>(s)), 0.0, durations, theta,
                                              models::Clock::time, setting.solver.flow);
        if (flow.status != models::FlowStatus::ok) return {};
        for (int k = 0; k < instants; ++k) {
            states.push_back(flow.states.col(k));
            shares.push_back(begin + mesh.segments[s].share * k / instants);
            gaps.push_back(relative_size(gap(states.back()), point.curve->scale()));
        }
        begin += mesh.segments[s].share;
    }
    std::vector<Approach> result;
    const std::size_t count = states.size();
    for (std::size_t k = 0; k < count; ++k) {
        if (gaps[k] > gaps[(k + count - 1) % count] || gaps[k] > gaps[(k + 1) % count]) continue;
        VectorXd state = states[k];
        double share = shares[k];
        for (int i = 0; i < most_improvements; ++i) {
            const VectorXd f = setting.system.rhs(state, std::vector<double>{0.0}, theta);
            const double time = f.dot(gap(state)) / f.squaredNorm();
            // Flows run forwards only: a step back starts from the sample before.
            if (!(std::abs(time) < mesh.time)) break;
            share += time / mesh.time;
            const std::size_t from = share < shares[k] ? (k + count - 1) % count : k;
            double ahead = (share - shares[from]) * mesh.time;
            if (ahead < 0.0) ahead += mesh.time;
            const double durations[] = {ahead};
            if (!(ahead < 0.5 * mesh.time)) break;
            const auto flow =
                setting.system.flow(states[from], 0.0, durations, theta, models::Clock::time, setting.solver.flow);
            if (flow.status != models::FlowStatus::ok) break;
            state = flow.states.col(0);
            if (std::abs(time) < 1e-10 * mesh.time) break;
        }
        result.push_back({share - std::floor(share), relative_size(gap(state), point.curve->scale())});
    }
    return result;
}

/// How far the orbit is from passing through these points, in their order from some one on.
double gap_between(const CurvePoint& point, const MatrixXd& points) {
    double smallest = std::numeric_limits<double>::infinity();
    if (point.curve->autonomous()) {
        for (const Approach& near : approaches(point, points.col(0)))
            smallest = std::min(smallest, near.distance);
        return smallest;
    }
    const MatrixXd own = section_points(point);
    const Index p = own.cols();
    for (Index shift = 0; shift < p && points.cols() == p; ++shift)
        smallest = std::min(smallest, distance(begun_later(own, shift) - points, *point.curve));
    return smallest;
}

/// The points of b's mirror image at the section; none without a symmetry, or when they cannot be simulated.
std::optional<MatrixXd> mirrored_points(const CurvePoint& b) {
    const CurveSetting& setting = b.curve->setting();
    const auto symmetry = setting.system.symmetry();
    if (!symmetry) return std::nullopt;
    const Eigen::Map<const VectorXd> signs(symmetry->signs.data(), static_cast<Index>(symmetry->signs.size()));
    MatrixXd points = section_points(b);
    const double shift = std::fmod(symmetry->phase_shift, 2.0 * std::numbers::pi);
    if (!b.curve->autonomous() && shift > 0.0) {
        // S x(tau) is a solution at tau + shift: the states a shift before the end of each period are wanted.
        const double durations[] = {2.0 * std::numbers::pi - shift};
        for (Index j = 0; j < points.cols(); ++j) {
            const auto flow =
                setting.system.flow(points.col(j), setting.phase, durations, setting.theta_at(b.parameter()),
                                    models::Clock::phase, setting.solver.flow);
            if (flow.status != models::FlowStatus::ok) return std::nullopt;
            points.col(j) = flow.states.col(0);
        }
    }
    return MatrixXd(signs.asDiagonal() * points);
}

bool comparable(const CurvePoint& a, const CurvePoint& b, double tolerance) {
    return a.curve->period() == b.curve->period() &&
           std::abs(a.parameter() - b.parameter()) <= tolerance * a.curve->setting().range &&
           std::abs(std::log(a.curve->time(a.y) / b.curve->time(b.y))) <= tolerance;
}

}  // namespace

PeriodicOrbit reported(const CurvePoint& walked) {
    const CurvePoint point = walked.curve->settled(walked);
    const OrbitCurve& curve = *point.curve;
    const CurveSetting& setting = curve.setting();
    const std::vector<Index> angles = angle_coordinates(setting.system);
    PeriodicOrbit orbit;
    orbit.status = OrbitStatus::converged;
    orbit.period = curve.period();
    orbit.rotation = curve.rotation();
    orbit.multipliers = point.multipliers;
    orbit.trivial_multiplier = point.trivial;
    orbit.residual = point.residual;
    orbit.iterations = point.iterations;
    orbit.sticking = point.sticking;
    orbit.time = curve.time(point.y);
    if (curve.autonomous()) {
        if (setting.section) {
            const Crossings crossings = crossings_of(point, *setting.section);
            orbit.points = wrapped_angles(crossings.states, angles);
            orbit.times = crossings.times;
            if (crossings.times.size() > 0) {
                orbit.period = static_cast<int>(crossings.times.size());
                return orbit;
            }
        }
        orbit.points = wrapped_angles(curve.nodes(point.y), angles);
        const std::vector<double> shares = curve.mesh().begins();
        orbit.times = orbit.time * Eigen::Map<const VectorXd>(shares.data(), orbit.points.cols());
        orbit.jacobians = point.jacobians;
        return orbit;
    }
    orbit.points = wrapped_angles(section_points(point), angles);
    orbit.jacobians = merged_factors(point.jacobians, curve.mesh().points);
    const Index p = orbit.points.cols();
    orbit.times = VectorXd::LinSpaced(p, 0.0, static_cast<double>(p - 1)) * (orbit.time / static_cast<double>(p));
    return orbit;
}

bool same_orbit(const CurvePoint& a, const CurvePoint& b, double tolerance) {
    return comparable(a, b, tolerance) && a.curve->rotation() == b.curve->rotation() &&
           gap_between(a, section_points(b)) <= tolerance;
}

bool mirror_images(const CurvePoint& a, const CurvePoint& b, double tolerance) {
    if (!comparable(a, b, tolerance)) return false;
    const auto points = mirrored_points(b);
    return points && gap_between(a, *points) <= tolerance;
}

double symmetry_gap(const CurvePoint& point) {
    const auto points = mirrored_points(point);
    return points ? gap_between(point, *points) : std::numeric_limits<double>::infinity();
}

double repetition_gap(const CurvePoint& point) {
    double smallest = std::numeric_limits<double>::infinity();
    if (point.curve->autonomous()) {
        // The first node itself is met at the start and after T.
        constexpr double itself = 1e-3;
        for (const Approach& near : approaches(point, point.curve->nodes(point.y).col(0)))
            if (near.share > itself && near.share < 1.0 - itself) smallest = std::min(smallest, near.distance);
        return smallest;
    }
    const MatrixXd points = section_points(point);
    const Index p = points.cols();
    for (Index shift = 1; shift < p; ++shift)
        if (p % shift == 0) smallest = std::min(smallest, distance(begun_later(points, shift) - points, *point.curve));
    return smallest;
}

}  // namespace orbid::periodic
