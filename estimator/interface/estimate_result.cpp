#include "estimator/interface/estimate_result.hpp"

#include <array>

namespace orbid::estimator {

std::string_view name(EstimateStatus status) {
    constexpr std::array names{"converged", "no_progress", "iteration_limit", "singular", "failed", "interrupted"};
    return names[static_cast<std::size_t>(status)];
}

std::string_view name(IntervalMethod method) {
    constexpr std::array names{"none",        "normal", "t",         "satterthwaite", "sandwich", "too_few_independent",
                               "chi_squared", "fixed",  "likelihood"};
    return names[static_cast<std::size_t>(method)];
}

std::string_view name(BoundSide side) {
    constexpr std::array names{"", "lower", "upper"};
    return names[static_cast<std::size_t>(side)];
}

std::string_view name(StepBlock block) {
    return block == StepBlock::theta ? "theta" : "scales";
}

std::string_view name(StepRejection reason) {
    constexpr std::array names{"", "no decrease", "block failed"};
    return names[static_cast<std::size_t>(reason)];
}

}  // namespace orbid::estimator
