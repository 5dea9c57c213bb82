#include "apps/drawing/plot_axis.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <string_view>

#include <fmt/format.h>

namespace orbid::apps {
namespace {

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
        if (factor * power >= rough * (1.0 - 1e-9)) return factor * power;
    }
    return 10.0 * power;
}

std::string labelled(const std::string& label, const std::string& unit) {
    return unit.empty() || unit == "1" ? label : fmt::format("{} [{}]", label, unit);
}

/// 10^exponent of the unit: "10⁻³ m".
std::string scaled_unit(int exponent, const std::string& unit) {
    if (exponent == 0) return unit;
    const std::string power = "10" + superscript(exponent);
    return unit.empty() || unit == "1" ? power : power + " " + unit;
}

/// Ticks at multiples of a round step, of (value - offset) / power.
void add_linear_ticks(PlotAxis& axis, double offset, double power, int wanted) {
    const double lower = (axis.lower - offset) / power;
    const double upper = (axis.upper - offset) / power;
    const double step = round_step((upper - lower) / std::max(1, wanted));
    const int decimals = std::max(0, static_cast<int>(-std::floor(std::log10(step * (1.0 + 1e-9)))));
    // Ends that are multiples of the step but for rounding keep their ticks.
    constexpr double rounding = 1e-9;
    const double last = std::floor(upper / step + rounding);
    for (double k = std::ceil(lower / step - rounding); k <= last; k += 1.0)
        axis.ticks.push_back({offset + k * step * power, tick_label(k == 0.0 ? 0.0 : k * step, decimals)});
}

}  // namespace

std::string superscript(int exponent) {
    constexpr std::array<std::string_view, 10> digits{"⁰", "¹", "²", "³", "⁴", "⁵", "⁶", "⁷", "⁸", "⁹"};
    std::string out;
    for (const char c : std::to_string(exponent))
        out += c == '-' ? std::string_view("⁻") : digits[static_cast<std::size_t>(c - '0')];
    return out;
}

PlotAxis linear_axis(const std::string& label, const std::string& unit, double lowest, double highest, int wanted) {
    PlotAxis axis;
    if (!std::isfinite(lowest) || !std::isfinite(highest)) lowest = highest = 0.0;
    if (!(highest > lowest)) {
        const double around = lowest == 0.0 ? 0.5 : 0.05 * std::abs(lowest);
        lowest -= around;
        highest += around;
    }
    axis.lower = lowest;
    axis.upper = highest;
    const double size = std::max(std::abs(lowest), std::abs(highest));
    const double width = highest - lowest;
    // Labels of more than five digits say what is common to them instead.
    constexpr double narrow = 1e-4;
    double offset = 0.0;
    std::string shown = label;
    if (width < narrow * size) {
        const double unit_of_offset = std::pow(10.0, std::ceil(std::log10(width)));
        offset = std::round(0.5 * (lowest + highest) / unit_of_offset) * unit_of_offset;
        const int decimals = std::clamp(static_cast<int>(-std::log10(unit_of_offset) + 0.5), 0, 17);
        const std::string digits = fmt::format("{:.{}f}", std::abs(offset), decimals);
        shown += (offset < 0.0 ? " + " : " − ") + digits;
    }
    const double reach = std::max(std::abs(lowest - offset), std::abs(highest - offset));
    // Powers of a thousand; 0.01 and 10000 are short enough as they are.
    int exponent = 0;
    if (!(reach >= 0.02) || reach >= 2e4) exponent = 3 * static_cast<int>(std::floor(std::log10(reach) / 3.0));
    axis.label = labelled(shown, scaled_unit(exponent, unit));
    add_linear_ticks(axis, offset, std::pow(10.0, exponent), wanted);
    return axis;
}

PlotAxis logarithmic_axis(const std::string& label, const std::string& unit, double lowest, double highest,
                          int wanted) {
    PlotAxis axis;
    axis.logarithmic = true;
    axis.label = labelled(label, unit);
    if (!(lowest > 0.0 && std::isfinite(lowest))) lowest = highest > 0.0 && std::isfinite(highest) ? highest : 1.0;
    if (!(highest > lowest) || !std::isfinite(highest)) {
        const double root = std::sqrt(10.0);
        highest = lowest * root;
        lowest /= root;
    }
    axis.lower = lowest;
    axis.upper = highest;
    constexpr double rounding = 1e-9;
    const int first = static_cast<int>(std::ceil(std::log10(lowest) - rounding));
    const int last = static_cast<int>(std::floor(std::log10(highest) + rounding));
    if (last - first + 1 >= 3) {
        const int step = std::max(1, (last - first + wanted) / wanted);
        for (int k = first; k <= last; ++k) {
            // Multiples of the step, so that 10⁰ is among them.
            if (k % step == 0) axis.ticks.push_back({std::pow(10.0, k), "10" + superscript(k)});
        }
        return axis;
    }
    for (int k = first - 1; k <= last; ++k) {
        for (const double factor : {1.0, 2.0, 5.0}) {
            const double value = factor * std::pow(10.0, k);
            if (value < lowest * (1.0 - rounding) || value > highest * (1.0 + rounding)) continue;
            const bool plain = k >= -3 && k <= 4;
            axis.ticks.push_back(
                {value, plain ? fmt::format("{:g}", value) : fmt::format("{:.0f}·10{}", factor, superscript(k))});
        }
    }
    return axis;
}

PlotAxis plot_axis(const ChartAxis& axis, int wanted) {
    constexpr double pi = std::numbers::pi;
    if (axis.log) return logarithmic_axis(axis.label, axis.unit, axis.lower, axis.upper, wanted);
    if (!axis.circle && !axis.whole && axis.names.empty())
        return linear_axis(axis.label, axis.unit, axis.lower, axis.upper, wanted);
    PlotAxis out{axis.lower, axis.upper, {}, labelled(axis.label, axis.unit), false, !axis.names.empty()};
    if (out.named) {
        for (std::size_t k = 0; k < axis.names.size(); ++k)
            out.ticks.push_back({static_cast<double>(k), axis.names[k], axis.notes.empty() ? "" : axis.notes[k]});
    } else if (axis.circle) {
        out.ticks = {{-pi, "−π"}, {-pi / 2.0, "−π/2"}, {0.0, "0"}, {pi / 2.0, "π/2"}, {pi, "π"}};
    } else {
        const double first = std::ceil(axis.lower);
        // Their labels are short.
        const double step = std::max(1.0, std::ceil(0.5 * (axis.upper - first) / std::max(1, wanted)));
        for (double value = first; value <= axis.upper; value += step)
            out.ticks.push_back({value, tick_label(value, 0)});
    }
    return out;
}

}  // namespace orbid::apps
