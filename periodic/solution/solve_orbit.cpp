#include "periodic/solution/solve_orbit.hpp"

#include "periodic/orbit/eigen_names.hpp"

namespace orbid::periodic {

PeriodicOrbit solve_orbit(const models::System& system, const VectorXd& theta, const StartingSolution& start,
                          std::span<const Index> free, const OrbitMethod& method) {
    if (const auto* shooting = std::get_if<ShootingOptions>(&method))
        return solve_multiple_shooting(system, theta, start, free, *shooting);
    if (const auto* differences = std::get_if<FiniteDifferenceOptions>(&method))
        return solve_finite_difference(system, theta, start, free, *differences);
    return solve_collocation(system, theta, start, free, std::get<CollocationOptions>(method));
}

}  // namespace orbid::periodic
