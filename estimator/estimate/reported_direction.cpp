#include "estimator/estimate/reported_direction.hpp"

#include <cmath>
#include <vector>

#include "estimator/uncertainty/identifiability.hpp"

namespace orbid::estimator {

std::string told_of(const Problem& problem, const State& state, const Eigen::VectorXd& size,
                    const Eigen::VectorXd& components) {
    constexpr double taking_part = 0.01, simple = 1e-3, parts = 12.0;
    Eigen::VectorXd rounded = components;
    bool powers = true;
    for (Eigen::Index i = 0; i < components.size(); ++i) {
        if (std::abs(components[i]) < taking_part) continue;
        rounded[i] = std::round(parts * components[i]) / parts;
        const double value = state.theta[i];
        powers = powers && std::abs(rounded[i] - components[i]) < simple && std::abs(size[i] - value) <= 1e-9 * value;
    }
    if (!powers) return what_is_told(components, problem.parameters, size);
    std::vector<FreeParameter> shown = problem.parameters;
    for (FreeParameter& parameter : shown)
        parameter.scale = Scale::log;
    return what_is_told(rounded, shown, size);
}

}  // namespace orbid::estimator
