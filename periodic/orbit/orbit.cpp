#include "periodic/orbit/orbit.hpp"

#include <cstddef>

namespace orbid::periodic {

std::string_view name(OrbitStatus status) {
    constexpr std::string_view names[] = {"converged",      "no_progress", "iteration_limit",
                                          "not_simulated",  "singular",    "other_orbit",
                                          "shorter_period", "equilibrium", "period_vanished"};
    return names[static_cast<std::size_t>(status)];
}

}  // namespace orbid::periodic
