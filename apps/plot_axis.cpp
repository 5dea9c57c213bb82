#include "apps/plot_axis.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <string_view>
#include <utility>

#include <fmt/format.h>

namespace orbid::apps {
namespace {

constexpr std::array<std::pair<std::string_view, std::string_view>, 16> greek{{{"alpha", "α"},
                                                                               {"beta", "β"},
                                                                               {"gamma", "γ"},
                                                                               {"delta", "δ"},
                                                                               {"epsilon", "ε"},
                                                                               {"zeta", "ζ"},
                                                                               {"eta", "η"},
                                                                               {"theta", "θ"},
                                                                               {"kappa", "κ"},
                                                                               {"lambda", "λ"},
                                                                               {"mu", "μ"},
                                                                               {"phi", "φ"},
                                                                               {"psi", "ψ"},
                                                                               {"rho", "ρ"},
                                                                               {"tau", "τ"},
                                                                               {"omega", "ω"}}};

std::string letter(std::string_view name) {
    const auto* const found =
        std::find_if(greek.begin(), greek.end(), [&](const auto& entry) { return entry.first == name; });
    return std::string(found == greek.end() ? name : found->second);
}

/// A number on an axis, with a typographic minus.
std::string tick_label(double value, int decimals) {
    const std::string digits = fmt::format("{:.{}f}", std::abs(value), decimals);
    return (value < 0.0 ? "−" : "") + digits;
}

/// The smallest of 1, 2, 5 times a power of ten that is not below `rough`.
double round_step(double rough) {
    const double power = std::pow(10.0, std::floor(std::log10(rough)));
    for (const double factor : {1.0, 2.0, 5.0}) {
        // A rough step of 0.2 must not become 0.5 because 2 * 0.1 is a rounding short of it.
        if (factor * power >= rough * (1.0 - 1e-9)) {
            return factor * power;
        }
    }
    return 10.0 * power;
}

}  // namespace

std::string display_name(const std::string& name) {
    constexpr std::string_view suffix = "_dot";
    if (name.size() > suffix.size() && name.ends_with(suffix)) {
        return fmt::format("d{}/dt", letter(std::string_view(name).substr(0, name.size() - suffix.size())));
    }
    return letter(name);
}

PlotAxis plot_axis(const orbits::SeriesCoordinate& coordinate, double lowest, double highest, int wanted) {
    constexpr double pi = std::numbers::pi;
    PlotAxis axis;
    axis.label = coordinate.unit.empty() ? display_name(coordinate.name)
                                         : fmt::format("{} [{}]", display_name(coordinate.name), coordinate.unit);
    if (coordinate.angle) {
        axis.circle = true;
        axis.lower = -pi;
        axis.upper = pi;
        axis.ticks = {{-pi, "−π"}, {-pi / 2.0, "−π/2"}, {0.0, "0"}, {pi / 2.0, "π/2"}, {pi, "π"}};
        return axis;
    }
    if (!std::isfinite(lowest) || !std::isfinite(highest)) {
        lowest = highest = 0.0;
    }
    if (!(highest > lowest)) {
        lowest -= 0.5;
        highest += 0.5;
    }
    constexpr double spare = 0.04;  // dots at the edge of the data keep clear of the frame
    const double margin = spare * (highest - lowest);
    axis.lower = lowest - margin;
    axis.upper = highest + margin;
    const double step = round_step((axis.upper - axis.lower) / std::max(1, wanted));
    const int decimals = std::max(0, static_cast<int>(-std::floor(std::log10(step * (1.0 + 1e-9)))));
    // Whole multiples of the step: adding it up would let rounding errors grow into the labels.
    const double first = std::ceil(axis.lower / step);
    const double last = std::floor(axis.upper / step);
    for (double k = first; k <= last; k += 1.0) {
        axis.ticks.push_back({k * step, tick_label(k * step, decimals)});
    }
    return axis;
}

}  // namespace orbid::apps
