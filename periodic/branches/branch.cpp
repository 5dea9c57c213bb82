#include "periodic/branches/branch.hpp"

namespace orbid::periodic {

std::string_view name(BranchEnd end) {
    constexpr std::string_view names[] = {"bound",         "closed",      "domain",       "point_limit",
                                          "smallest_step", "equilibrium", "period_limit", "other_branch",
                                          "not_simulated", "start",       "interrupted"};
    return names[static_cast<std::size_t>(end)];
}

}  // namespace orbid::periodic
