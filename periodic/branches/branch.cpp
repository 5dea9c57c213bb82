#include "periodic/branches/branch.hpp"

namespace orbid::periodic {

std::string_view name(BranchEnd end) {
    switch (end) {
        case BranchEnd::bound:
            return "bound";
        case BranchEnd::closed:
            return "closed";
        case BranchEnd::domain:
            return "domain";
        case BranchEnd::point_limit:
            return "point_limit";
        case BranchEnd::smallest_step:
            return "smallest_step";
        case BranchEnd::equilibrium:
            return "equilibrium";
        case BranchEnd::period_limit:
            return "period_limit";
        case BranchEnd::other_branch:
            return "other_branch";
        case BranchEnd::not_simulated:
            return "not_simulated";
        case BranchEnd::start:
            return "start";
        case BranchEnd::interrupted:
            return "interrupted";
    }
    return "unknown";
}

}  // namespace orbid::periodic
