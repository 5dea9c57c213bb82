#include "identification/problem/identification_options.hpp"

#include <stdexcept>

#include <fmt/format.h>

namespace orbid::identification {

void validate(const Options& options) {
    const auto refuse = [](const char* name, double value, const char* rule) {
        throw std::invalid_argument(fmt::format("{} {}: must be {}", name, value, rule));
    };
    if (!(options.step_tolerance > 0.0)) refuse("step_tolerance", options.step_tolerance, "> 0");
    if (options.starts < 1) refuse("starts", static_cast<double>(options.starts), ">= 1");
    const double held_out = options.comparison.held_out;
    if (!(held_out >= 0.0 && held_out <= 0.5)) refuse("held_out", held_out, "in [0, 0.5]");
    for (std::size_t i = 1; i < options.strategy.size(); ++i)
        if (options.strategy[i].kind == Stage::Kind::prediction)
            throw std::invalid_argument("strategy: the prediction gives a start: it must be the first stage");
}

}  // namespace orbid::identification
