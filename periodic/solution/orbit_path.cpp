#include "periodic/solution/orbit_path.hpp"

#include <cmath>
#include <limits>

#include "models/definition/parameter.hpp"
#include "periodic/orbit/eigen_names.hpp"
#include "periodic/orbit/full_turn.hpp"
#include "periodic/solution/multiple_shooting.hpp"

namespace orbid::periodic {
namespace {

bool lies_in_domain(const models::System& system, const VectorXd& values) {
    for (Index i = 0; i < values.size(); ++i)
        if (!models::contains(system.parameters()[static_cast<std::size_t>(i)].domain, values(i))) return false;
    return true;
}

/// The size of an orbit as its points show it: never 0.
VectorXd size_of(const models::System& system, const PeriodicOrbit& orbit) {
    VectorXd size = orbit.points.rowwise().norm() / std::sqrt(static_cast<double>(orbit.points.cols()));
    for (Index i = 0; i < size.size(); ++i) {
        if (system.coordinates()[static_cast<std::size_t>(i)].angle) size(i) = full_turn;
        // A coordinate that is 0 on the section moves elsewhere.
        if (!(size(i) > 1e-3 * size.maxCoeff())) size(i) = std::max(size.maxCoeff(), 1e-300);
    }
    return size;
}

PeriodicOrbit one_step(const models::System& system, const VectorXd& from, const PeriodicOrbit& orbit,
                       const VectorXd& to, std::span<const Index> free, const OrbitPlace& place,
                       const OrbitPathOptions& options) {
    PeriodicOrbit none;
    none.status = OrbitStatus::not_simulated;
    if (!to.allFinite() || !lies_in_domain(system, to)) return none;
    StartingSolution start = place.start(system, orbit);
    VectorXd step(std::ssize(free));
    for (Index i = 0; i < step.size(); ++i)
        step(i) = to(free[static_cast<std::size_t>(i)]) - from(free[static_cast<std::size_t>(i)]);
    if (step.size() > 0) {
        const VectorXd move = orbit.sensitivities.topRows(start.points.size()) * step;
        start.points += move.reshaped(start.points.rows(), start.points.cols());
        if (start.time > 0.0) start.time *= std::exp(orbit.time_sensitivities.dot(step) / orbit.time);
    }
    if (!start.points.allFinite() || !(start.time < std::numeric_limits<double>::infinity())) return none;
    ShootingOptions solver = options.solver;
    solver.scale = size_of(system, orbit);
    solver.maximum_distance = options.maximum_move;
    return solve_multiple_shooting(system, to, start, free, solver);
}

}  // namespace

StartingSolution OrbitPlace::start(const models::System& system, const PeriodicOrbit& orbit) const {
    StartingSolution start;
    start.points = orbit.points;
    start.rotation = orbit.rotation;
    start.phase = phase;
    start.section = section;
    if (system.kind() == models::Kind::autonomous && !section) {
        start.points = orbit.points.leftCols(1);
        start.time = orbit.time;
    }
    return start;
}

PeriodicOrbit orbit_along(const models::System& system, const VectorXd& from, const PeriodicOrbit& orbit,
                          const VectorXd& to, std::span<const Index> free, const OrbitPlace& place,
                          const OrbitPathOptions& options) {
    PeriodicOrbit last;
    for (int halvings = 0; halvings <= options.most_halvings; ++halvings) {
        const int steps = 1 << halvings;
        last = orbit;
        VectorXd at = from;
        for (int i = 1; i <= steps; ++i) {
            const VectorXd next = i == steps ? to : VectorXd(from + (static_cast<double>(i) / steps) * (to - from));
            last = one_step(system, at, last, next, free, place, options);
            if (last.status != OrbitStatus::converged) break;
            at = next;
        }
        if (last.status == OrbitStatus::converged) return last;
    }
    return last;
}

}  // namespace orbid::periodic
