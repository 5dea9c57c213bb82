#include "periodic/orbit/shooting_mesh.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <stdexcept>
#include <string>

#include "models/arithmetic/singular_values.hpp"
#include "periodic/orbit/coarse_flow.hpp"
#include "periodic/orbit/winding_number.hpp"

namespace orbid::periodic {
namespace {

/// Instants of a segment at which the growth of errors is looked at; no segment gets more nodes than that.
constexpr int instants = 48;

/// Growth is known well enough from derivatives with this error.
constexpr double coarse_tolerance = 1e-7;

/// A return takes at most this many times the longest time scale of the start, |x| / |f|, summed over the coordinates.
/// It only keeps the search for a crossing finite.
constexpr double longest_return = 1e3;

void require(bool holds, const std::string& message) {
    if (!holds) throw std::invalid_argument("periodic orbit: " + message);
}

/// ln of the ratio of the largest to the smallest growth of an error under X. A direction that is lost altogether
/// (sticking) has no growth backwards.
double ln_growth(const MatrixXd& x) {
    const VectorXd values = models::singular_values(x);
    const double largest = values(0);
    const double smallest = values(values.size() - 1);
    if (!(largest > 0.0) || !std::isfinite(largest)) return 0.0;
    return smallest > 1e-15 * largest ? std::log(largest / smallest) : std::max(std::log(largest), 0.0);
}

/// A crossing within this fraction of the next return is the start itself, which rounding has put before the plane.
constexpr double at_start = 1e-9;

/// The first crossing of a plane by the motion from a state; a state on the plane does not cross it at once.
models::CrossingResult next_crossing(const models::System& system, const VectorXd& theta, const VectorXd& x,
                                     const models::Section& plane, const models::FlowOptions& options) {
    const double longest = longest_return * motion_time(system, theta, x);
    models::CrossingResult first = system.crossings(x, plane, 1, longest, theta, std::nullopt, options);
    const bool before = plane.direction * (plane.normal.dot(x) - plane.offset) < 0.0;
    if (!before || first.status != models::FlowStatus::ok || first.times.size() == 0) return first;
    models::CrossingResult two = system.crossings(x, plane, 2, longest, theta, std::nullopt, options);
    if (two.times.size() < 2 || first.times(0) > at_start * two.times(1)) return first;
    two.times = two.times.tail(1).eval();
    return two;
}

void find_segments_between_crossings(const models::System& system, const VectorXd& theta, const StartingSolution& start,
                                     const models::FlowOptions& options, ShootingMesh& mesh) {
    const Index p = mesh.nodes.cols();
    for (Index j = 0; j < p; ++j) {
        const VectorXd x = mesh.nodes.col(j);
        const auto crossing = next_crossing(system, theta, x, *start.section, options);
        if (crossing.status != models::FlowStatus::ok || crossing.times.size() == 0) {
            mesh.time = motion_time(system, theta, x);
            return;
        }
        mesh.segments[static_cast<std::size_t>(j)].duration = crossing.times(0);
        mesh.time += crossing.times(0);
    }
    for (Segment& segment : mesh.segments)
        segment.share = segment.duration / mesh.time;
    mesh.simulated = true;
}

void check(const models::System& system, const VectorXd& theta, const StartingSolution& start) {
    const auto parameters = static_cast<Index>(system.parameters().size());
    const auto text = [](auto value) { return std::to_string(value); };
    require(theta.size() == parameters,
            "theta has " + text(theta.size()) + " values, the model has " + text(parameters) + " parameters");
    require(theta.allFinite(), "theta must be finite");
    require(std::isfinite(start.phase), "phase must be finite");
    require(start.points.rows() == system.dimension() && start.points.cols() >= 1,
            "guess has shape (" + text(start.points.rows()) + ", " + text(start.points.cols()) + "), needed is (" +
                text(system.dimension()) + ", p) with p >= 1");
    require(start.points.allFinite(), "guess must be finite");
    const auto table = system.coordinates();
    const auto angles = std::count_if(table.begin(), table.end(), [](const auto& c) { return c.angle; });
    require(start.rotation.empty() || static_cast<long>(start.rotation.size()) == angles,
            "rotation has " + text(start.rotation.size()) + " numbers, the model has " + text(angles) + " angles");
    if (system.kind() != models::Kind::autonomous) {
        require(!start.section && start.time == 0.0,
                "a section plane and an unknown period belong to autonomous "
                "models; " +
                    std::string(system.name()) + " is none");
    } else if (!start.section) {
        require(start.time > 0.0 && std::isfinite(start.time), "time is " + text(start.time) +
                                                                   ", must be > 0: " + std::string(system.name()) +
                                                                   " is autonomous and no section is given");
        require(start.points.cols() == 1, "without a section one state is needed, not " + text(start.points.cols()));
    }
}

bool is_point(const ShootingMesh& mesh, std::size_t node) {
    return std::find(mesh.points.begin(), mesh.points.end(), static_cast<Index>(node)) != mesh.points.end();
}

}  // namespace

double motion_time(const models::System& system, const VectorXd& theta, const VectorXd& x) {
    const std::vector<double> phase{0.0};
    constexpr double slowest = 1e-6;
    const double rate = system.rhs(x, phase, theta).norm();
    const double rate_of_errors = system.rhs_derivatives(x, phase, theta, {}).norm();
    const double size = std::max(x.norm(), system.state_size());
    const double time = size / std::max(rate, slowest * rate_of_errors * size);
    return std::isfinite(time) && time > 0.0 ? time : 1.0;
}

std::vector<double> ShootingMesh::begins() const {
    std::vector<double> result;
    double share = 0.0;
    for (const Segment& segment : segments) {
        result.push_back(share);
        share += segment.share;
    }
    return result;
}

ShootingMesh mesh_from_guess(const models::System& system, const VectorXd& theta, const StartingSolution& start,
                             const models::FlowOptions& options) {
    check(system, theta, start);
    const Index p = start.points.cols();
    ShootingMesh mesh;
    mesh.nodes = start.points;
    mesh.segments.resize(static_cast<std::size_t>(p));
    for (Index j = 0; j < p; ++j)
        mesh.points.push_back(j);
    mesh.clock = system.kind() == models::Kind::forced ? models::Clock::phase : models::Clock::time;
    if (start.section) {
        find_segments_between_crossings(system, theta, start, options, mesh);
        return mesh;
    }
    double duration = 1.0;
    mesh.time = static_cast<double>(p);
    if (system.kind() == models::Kind::forced) {
        duration = system.period(theta, models::Clock::phase);
        mesh.time *= system.period(theta, models::Clock::time);
    } else if (system.kind() == models::Kind::autonomous) {
        duration = mesh.time = start.time;
    }
    mesh.simulated = true;
    for (Segment& segment : mesh.segments)
        segment = {start.phase, duration, 1.0 / static_cast<double>(p)};
    return mesh;
}

ShootingMesh refined(const models::System& system, const VectorXd& theta, const ShootingMesh& mesh, double growth,
                     const models::FlowOptions& options) {
    if (system.kind() == models::Kind::map || !mesh.simulated) return mesh;
    const models::FlowOptions coarse = coarsened(options, coarse_tolerance);
    const Index n = mesh.nodes.rows();
    ShootingMesh finer = mesh;
    finer.segments.clear();
    finer.points.clear();
    std::vector<VectorXd> nodes;
    for (std::size_t s = 0; s < mesh.segments.size(); ++s) {
        const Segment& whole = mesh.segments[s];
        const VectorXd start = mesh.nodes.col(static_cast<Index>(s));
        std::vector<double> durations(instants);
        for (int k = 0; k < instants; ++k)
            durations[static_cast<std::size_t>(k)] = whole.duration * (k + 1) / instants;
        const auto flow = system.flow_with_sensitivities(start, whole.phase, durations, theta, {}, mesh.clock, coarse);
        // The largest growth so far, at each instant.
        std::vector<double> most;
        if (flow.status == models::FlowStatus::ok)
            for (Index k = 0; k < instants; ++k)
                most.push_back(std::max(most.empty() ? 0.0 : most.back(), ln_growth(flow.sensitivity(k, n))));
        const double total = most.empty() ? 0.0 : most.back();
        const int pieces = std::clamp(static_cast<int>(std::ceil(total / std::log(growth))), 1, instants);
        double done = 0.0;
        if (is_point(mesh, s)) finer.points.push_back(static_cast<Index>(nodes.size()));
        nodes.push_back(start);
        const auto close_at = [&](double part) {
            const double share = part - done;
            finer.segments.push_back({whole.phase + (mesh.clock == models::Clock::phase ? whole.duration * done : 0.0),
                                      whole.duration * share, whole.share * share});
            done = part;
        };
        int next = 1;
        for (int k = 0; k + 1 < instants && next < pieces; ++k) {
            if (most[static_cast<std::size_t>(k)] < total * next / pieces) continue;
            close_at(static_cast<double>(k + 1) / instants);
            nodes.push_back(flow.states.col(k));
            while (next < pieces && most[static_cast<std::size_t>(k)] >= total * next / pieces)
                ++next;
        }
        close_at(1.0);
    }
    finer.nodes.resize(n, static_cast<Index>(nodes.size()));
    for (std::size_t j = 0; j < nodes.size(); ++j)
        finer.nodes.col(static_cast<Index>(j)) = nodes[j];
    return finer;
}

ShootingMesh split_uniformly(const models::System& system, const VectorXd& theta, const ShootingMesh& mesh, int pieces,
                             const models::FlowOptions& options) {
    ShootingMesh finer = mesh;
    finer.simulated = false;
    finer.segments.clear();
    finer.points.clear();
    finer.nodes.resize(mesh.nodes.rows(), pieces * mesh.nodes.cols());
    for (std::size_t s = 0; s < mesh.segments.size(); ++s) {
        const Segment& whole = mesh.segments[s];
        const auto first = static_cast<Index>(s) * pieces;
        std::vector<double> durations;
        for (int k = 0; k < pieces; ++k) {
            const double begin = whole.duration * k / pieces;
            durations.push_back(begin);
            finer.segments.push_back({whole.phase + (mesh.clock == models::Clock::phase ? begin : 0.0),
                                      whole.duration / pieces, whole.share / pieces});
        }
        const auto flow =
            system.flow(mesh.nodes.col(static_cast<Index>(s)), whole.phase, durations, theta, mesh.clock, options);
        if (flow.status != models::FlowStatus::ok) return finer;
        finer.nodes.middleCols(first, pieces) = flow.states;
        if (is_point(mesh, s)) finer.points.push_back(first);
    }
    finer.simulated = mesh.simulated;
    return finer;
}

bool grows_beyond(const MatrixXd& jacobian, double growth) {
    return ln_growth(jacobian) > std::log(growth);
}

int pieces_of(const MatrixXd& jacobian, double growth) {
    return std::clamp(static_cast<int>(std::ceil(ln_growth(jacobian) / std::log(growth))), 1, instants);
}

SampledMesh sampled(const models::System& system, const VectorXd& theta, const ShootingMesh& mesh,
                    std::span<const double> shares, const models::FlowOptions& options) {
    const std::vector<Index> angles = angle_coordinates(system);
    SampledMesh result;
    result.states.resize(mesh.nodes.rows(), static_cast<Index>(shares.size()));
    result.turns = VectorXd::Zero(mesh.nodes.rows());
    std::size_t next = 0;
    double begin = 0.0;
    const std::size_t count = mesh.segments.size();
    for (std::size_t s = 0; s < count; ++s) {
        const Segment& segment = mesh.segments[s];
        const double end = s + 1 < count ? begin + segment.share : 1.0;
        std::vector<double> durations;
        const auto first = static_cast<Index>(next);
        for (; next < shares.size() && shares[next] < end; ++next)
            durations.push_back(segment.duration * std::clamp((shares[next] - begin) / segment.share, 0.0, 1.0));
        durations.push_back(segment.duration);
        begin = end;
        const auto flow =
            system.flow(mesh.nodes.col(static_cast<Index>(s)), segment.phase, durations, theta, mesh.clock, options);
        if (flow.status != models::FlowStatus::ok || !flow.states.allFinite()) return result;
        const auto inside = static_cast<Index>(durations.size()) - 1;
        result.states.middleCols(first, inside) =
            flow.states.leftCols(inside).colwise() + 2.0 * std::numbers::pi * result.turns;
        const MatrixXd gap = flow.states.col(inside) - mesh.nodes.col(static_cast<Index>((s + 1) % count));
        result.turns += winding_numbers(gap, angles, {});
    }
    result.simulated = true;
    return result;
}

}  // namespace orbid::periodic
