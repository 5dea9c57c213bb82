#include "periodic/solution/orbit_path.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "models/definition/parameter.hpp"
#include "periodic/orbit/eigen_names.hpp"
#include "periodic/orbit/full_turn.hpp"
#include "periodic/orbit/orbit_amplitude.hpp"
#include "periodic/solution/multiple_shooting.hpp"

namespace orbid::periodic {
namespace {

bool lies_in_domain(const models::System& system, const VectorXd& values) {
    for (Index i = 0; i < values.size(); ++i)
        if (!models::contains(system.parameters()[static_cast<std::size_t>(i)].domain, values(i))) return false;
    return true;
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
    return solve_multiple_shooting(system, to, start, free, options.solver);
}

}  // namespace

VectorXd orbit_size(const models::System& system, const VectorXd& values, double phase, const PeriodicOrbit& orbit) {
    const OrbitAmplitude amplitude = amplitude_of(system, values, phase, orbit, {});
    VectorXd size = VectorXd::Constant(system.dimension(), full_turn);
    for (Index i = 0; i < std::min(size.size(), amplitude.rms.size()); ++i) {
        // An angle that turns around has no amplitude.
        const double own = std::max(amplitude.half_range(i), amplitude.rms(i));
        if (std::isfinite(own)) size(i) = own > 0.0 ? own : 1.0;
    }
    return size;
}

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
                          const OrbitPathOptions& asked) {
    OrbitPathOptions options = asked;
    options.solver.maximum_distance = options.maximum_move;
    if (options.solver.scale.size() == 0) options.solver.scale = orbit_size(system, from, place.phase, orbit);
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
