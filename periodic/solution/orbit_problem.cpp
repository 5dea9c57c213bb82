#include "periodic/solution/orbit_problem.hpp"

#include <stdexcept>

#include "periodic/orbit/winding_number.hpp"

namespace orbid::periodic {
namespace {

void require_orbit(bool holds, const std::string& message) {
    if (!holds) throw std::invalid_argument("periodic orbit: " + message);
}

}  // namespace

VectorXd OrbitProblem::scale() const {
    return options.scale.size() > 0 ? options.scale : default_scale(system, start.points);
}

PeriodicOrbit OrbitProblem::unsolved(OrbitStatus status) const {
    PeriodicOrbit orbit;
    orbit.status = status;
    orbit.period = static_cast<int>(start.points.cols());
    return orbit;
}

void validate(const OrbitProblem& problem) {
    const ShootingOptions& options = problem.options;
    const auto parameters = static_cast<Index>(problem.system.parameters().size());
    for (const Index index : problem.free)
        require_orbit(index >= 0 && index < parameters,
                      "free parameter " + std::to_string(index) + " is not in [0, " + std::to_string(parameters) + ")");
    require_orbit(options.tolerance > 0.0, "tolerance must be > 0");
    require_orbit(options.maximum_iterations > 0, "maximum_iterations must be > 0");
    require_orbit(options.minimum_damping > 0.0 && options.minimum_damping < 1.0, "minimum_damping must lie in (0, 1)");
    require_orbit(options.maximum_distance > 0.0, "maximum_distance must be > 0");
    require_orbit(options.segment_growth > 1.0, "segment_growth must be > 1");
    require_orbit(options.scale.size() == 0 || (options.scale.size() == problem.system.dimension() &&
                                                options.scale.allFinite() && options.scale.minCoeff() > 0.0),
                  "scale must be empty or hold one finite value > 0 per coordinate");
}

void require_flow(const models::System& system, const std::string& method) {
    if (system.kind() == models::Kind::map)
        throw std::invalid_argument(method + ": a map has no time derivative; use multiple shooting");
}

void require_smooth(const OrbitProblem& problem, const std::string& method) {
    if (!problem.system.smooth(problem.theta))
        throw std::invalid_argument(method + ": " + std::string(problem.system.name()) +
                                    " is not smooth at these parameters; use multiple shooting");
}

}  // namespace orbid::periodic
