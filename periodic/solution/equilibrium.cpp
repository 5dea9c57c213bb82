#include "periodic/solution/equilibrium.hpp"

#include <vector>

#include "periodic/solution/newton.hpp"

namespace orbid::periodic {

bool at_equilibrium(const models::System& system, const Eigen::VectorXd& theta, const Eigen::MatrixXd& states,
                    double time, const Eigen::VectorXd& scale) {
    if (system.kind() != models::Kind::autonomous) return false;
    // Orbits smaller than this fraction of the scale cannot be distinguished from the equilibrium they surround. Their
    // points are accurate to 1e-9 of it, so only three digits of their size would be known.
    constexpr double smallest_orbit = 1e-6;
    const Eigen::VectorXd first = states.col(0);
    const Eigen::VectorXd way = time * system.rhs(first, std::vector<double>{0.0}, theta);
    return relative_size(way, scale) < smallest_orbit &&
           relative_size(states.colwise() - first, scale) < smallest_orbit;
}

}  // namespace orbid::periodic
