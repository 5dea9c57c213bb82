#include "periodic/orbit/orbit.hpp"

namespace orbid::periodic {

std::string_view name(OrbitStatus status) {
    switch (status) {
        case OrbitStatus::converged:
            return "converged";
        case OrbitStatus::no_progress:
            return "no_progress";
        case OrbitStatus::iteration_limit:
            return "iteration_limit";
        case OrbitStatus::not_simulated:
            return "not_simulated";
        case OrbitStatus::singular:
            return "singular";
        case OrbitStatus::other_orbit:
            return "other_orbit";
        case OrbitStatus::shorter_period:
            return "shorter_period";
        case OrbitStatus::equilibrium:
            return "equilibrium";
        case OrbitStatus::period_vanished:
            return "period_vanished";
    }
    return "unknown";
}

}  // namespace orbid::periodic
