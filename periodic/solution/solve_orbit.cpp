#include "periodic/solution/solve_orbit.hpp"

namespace orbid::periodic {
namespace {

struct Solve {
    const models::System& system;
    const Eigen::VectorXd& theta;
    const StartingSolution& start;
    std::span<const Eigen::Index> free;

    PeriodicOrbit operator()(const ShootingOptions& options) const {
        return solve_multiple_shooting(system, theta, start, free, options);
    }
    PeriodicOrbit operator()(const FiniteDifferenceOptions& options) const {
        return solve_finite_difference(system, theta, start, free, options);
    }
    PeriodicOrbit operator()(const CollocationOptions& options) const {
        return solve_collocation(system, theta, start, free, options);
    }
};

}  // namespace

PeriodicOrbit solve_orbit(const models::System& system, const Eigen::VectorXd& theta, const StartingSolution& start,
                          std::span<const Eigen::Index> free, const OrbitMethod& method) {
    return std::visit(Solve{system, theta, start, free}, method);
}

}  // namespace orbid::periodic
