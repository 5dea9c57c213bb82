#include "orbits/simulation/phase_rate.hpp"

#include <numbers>

namespace orbid::orbits {

double phase_rate(const models::System& system, const Eigen::VectorXd& theta) {
    if (system.kind() == models::Kind::forced)
        return 2.0 * std::numbers::pi / system.period(theta, models::Clock::time);
    return system.inputs().empty() ? 0.0 : 1.0;
}

}  // namespace orbid::orbits
