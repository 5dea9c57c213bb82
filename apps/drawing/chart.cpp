#include "apps/drawing/chart.hpp"

#include <array>
#include <numbers>
#include <string_view>
#include <utility>

#include <fmt/format.h>

#include "models/definition/parameter.hpp"

namespace orbid::apps {

namespace {

constexpr std::array<std::pair<std::string_view, std::string_view>, 20> greek{
    {{"alpha", "α"}, {"beta", "β"},  {"gamma", "γ"},  {"delta", "δ"}, {"epsilon", "ε"}, {"zeta", "ζ"}, {"eta", "η"},
     {"theta", "θ"}, {"kappa", "κ"}, {"lambda", "λ"}, {"mu", "μ"},    {"phi", "φ"},     {"psi", "ψ"},  {"rho", "ρ"},
     {"sigma", "σ"}, {"nu", "ν"},    {"xi", "ξ"},     {"chi", "χ"},   {"tau", "τ"},     {"omega", "ω"}}};

std::string letter(std::string_view name) {
    const auto* const found =
        std::find_if(greek.begin(), greek.end(), [&](const auto& entry) { return entry.first == name; });
    return std::string(found == greek.end() ? name : found->second);
}

ChartLayer rule(std::string name, Ink ink, bool dash) {
    ChartLayer layer{LayerKind::rule, std::move(name), 1, ink};
    layer.dash = dash;
    return layer;
}

}  // namespace

std::string_view name(LayerKind kind) {
    constexpr std::array<std::string_view, 8> names{"density", "points",    "line", "band",
                                                    "bars",    "intervals", "rule", "cells"};
    return names[static_cast<std::size_t>(kind)];
}

std::string_view name(Ink ink) {
    constexpr std::array<std::string_view, 4> names{"", "soft", "ink", "cloud"};
    return names[static_cast<std::size_t>(ink)];
}

std::string display_name(const std::string& name) {
    constexpr std::string_view over = "_over_";
    constexpr std::string_view dot = "_dot";
    const auto at = name.find(over);
    if (at != std::string::npos && at > 0 && at + over.size() < name.size())
        return display_name(name.substr(0, at)) + "/" + display_name(name.substr(at + over.size()));
    if (name.size() > dot.size() && name.ends_with(dot))
        return fmt::format("d{}/dt", letter(std::string_view(name).substr(0, name.size() - dot.size())));
    return letter(name);
}

std::string grouped_digits(std::size_t value, const char* space) {
    std::string digits = std::to_string(value);
    for (auto at = static_cast<std::ptrdiff_t>(digits.size()) - 3; at > 0; at -= 3)
        digits.insert(static_cast<std::size_t>(at), space);
    return digits;
}

void ChartLayer::follow(double at, double value, bool angle) {
    const double shown = angle ? models::wrapped(value) : value;
    if (angle && !y.empty() && std::abs(shown - y.back()) > std::numbers::pi) lift();
    add(at, shown);
}

void ChartLayer::lift() {
    add(std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::quiet_NaN());
}

ChartLayer upright_rule(double at_x, std::string name, Ink ink, bool dash) {
    ChartLayer layer = rule(std::move(name), ink, dash);
    layer.at_x = at_x;
    return layer;
}

ChartLayer level_rule(double at_y, std::string name, Ink ink, bool dash) {
    ChartLayer layer = rule(std::move(name), ink, dash);
    layer.at_y = at_y;
    return layer;
}

void append_words(std::string& list, const std::string& words, std::string_view between) {
    if (!list.empty()) list += between;
    list += words;
}

void name_lines(ChartView& view, std::vector<std::string> names) {
    const double last = static_cast<double>(names.size()) - 1.0;
    for (ChartLayer& layer : view.layers) {
        for (double& height : layer.y)
            height = last - height;
    }
    std::reverse(names.begin(), names.end());
    std::reverse(view.y.notes.begin(), view.y.notes.end());
    view.y.names = std::move(names);
    view.y.lower = -0.6;
    view.y.upper = last + 0.6;
    // One line of text per name, however few.
    view.height = std::min(0.8, 0.16 + 0.05 * (last + 1.0));
}

ChartAxis ChartRange::axis(const orbits::SeriesCoordinate& coordinate) const {
    ChartAxis out = axis(display_name(coordinate.name), coordinate.unit);
    if (coordinate.angle) {
        out.lower = -std::numbers::pi;
        out.upper = std::numbers::pi;
        out.circle = true;
    }
    return out;
}

ChartAxis ChartRange::axis(std::string label, std::string unit, bool log) const {
    constexpr double spare = 0.04;
    ChartAxis out{std::move(label), std::move(unit)};
    out.log = log && lowest > 0.0;
    double lower = empty() ? 0.0 : lowest;
    double upper = empty() ? 0.0 : highest;
    if (out.log) {
        const double room = std::max(spare * (std::log10(upper) - std::log10(lower)), 0.1);
        out.lower = lower * std::pow(10.0, -room);
        out.upper = upper * std::pow(10.0, room);
        return out;
    }
    double room = spare * (upper - lower);
    // A single value, or values that differ by rounding alone.
    if (!(room > 1e-12 * std::max(std::abs(lower), std::abs(upper))))
        room = lower == 0.0 && upper == 0.0 ? 0.5 : 0.05 * std::max(std::abs(lower), std::abs(upper));
    out.lower = lower - room;
    out.upper = upper + room;
    return out;
}

}  // namespace orbid::apps
