#include "apps/report/report_chart.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "apps/report/base64_text.hpp"

namespace orbid::apps {

namespace {

using Json = nlohmann::ordered_json;

/// Lists up to this stand as they are: base64 would save nothing worth the loss.
constexpr std::size_t plain_numbers = 64;
/// Longer ones are read off at the width of a screen: 16 bits are a sixtieth of a pixel there.
constexpr std::size_t fine_numbers = std::size_t{1} << 16;

/// Equal steps up to a thousandth of one: rounding of times in a file.
bool is_even(std::span<const double> values) {
    const double step = (values.back() - values.front()) / static_cast<double>(values.size() - 1);
    if (!(step > 0.0)) return false;
    for (std::size_t i = 0; i < values.size(); ++i) {
        const double expected = values.front() + step * static_cast<double>(i);
        if (!(std::abs(values[i] - expected) < 1e-3 * step)) return false;
    }
    return true;
}

Json in_steps(std::span<const double> values) {
    ChartRange range;
    range.include(values);
    // Nothing is defined: every code is the highest.
    const double lower = range.empty() ? 0.0 : range.lowest;
    const double upper = range.empty() ? 0.0 : range.highest;
    const unsigned bits = values.size() <= fine_numbers ? 32 : 16;
    const std::uint32_t undefined = bits == 32 ? 0xffffffffU : 0xffffU;
    const double last = static_cast<double>(undefined - 1);
    std::vector<unsigned char> bytes;
    bytes.reserve(values.size() * bits / 8);
    for (const double value : values) {
        // Halves first: the range of the doubles themselves would overflow.
        const double share = upper > lower ? (0.5 * value - 0.5 * lower) / (0.5 * upper - 0.5 * lower) : 0.0;
        const std::uint32_t code =
            std::isfinite(value) ? static_cast<std::uint32_t>(std::llround(share * last)) : undefined;
        for (unsigned shift = 0; shift < bits; shift += 8)
            bytes.push_back(static_cast<unsigned char>(code >> shift));
    }
    return {{"bits", bits}, {"lower", lower}, {"upper", upper}, {"base64", base64_text(bytes)}};
}

/// Ascending without gaps: the page then finds what is in view by bisection.
bool rises(const std::vector<double>& x) {
    for (std::size_t i = 0; i < x.size(); ++i)
        if (!std::isfinite(x[i]) || (i > 0 && !(x[i] >= x[i - 1]))) return false;
    return x.size() > 1;
}

Json axis_json(const ChartAxis& axis) {
    Json out{{"label", axis.label}, {"lower", axis.lower}, {"upper", axis.upper}};
    if (!axis.unit.empty() && axis.unit != "1") out["unit"] = axis.unit;
    if (axis.log) out["log"] = true;
    if (axis.deep) out["deep"] = true;
    if (axis.circle) out["circle"] = true;
    if (axis.whole) out["whole"] = true;
    if (!axis.names.empty()) out["names"] = axis.names;
    return out;
}

Json layer_json(const ChartLayer& layer) {
    Json out{{"kind", name(layer.kind)}, {"name", layer.name}, {"style", layer.style}};
    if (layer.ink != Ink::of_style) out["ink"] = name(layer.ink);
    const auto add = [&out](const char* key, const std::vector<double>& values) {
        if (!values.empty()) out[key] = packed_numbers(values);
    };
    if (layer.kind != LayerKind::density) {
        add("x", layer.x);
        add("y", layer.y);
    }
    add("lower", layer.lower);
    add("upper", layer.upper);
    if (!layer.labels.empty()) out["labels"] = layer.labels;
    if (layer.open) out["open"] = true;
    if (layer.dash) out["dash"] = true;
    if (layer.at_x) out["at_x"] = *layer.at_x;
    if (layer.at_y) out["at_y"] = *layer.at_y;
    if (layer.kind == LayerKind::line && rises(layer.x)) out["rising"] = true;
    return out;
}

}  // namespace

Json packed_numbers(std::span<const double> values) {
    if (values.size() <= plain_numbers) {
        Json out = Json::array();
        for (const double value : values)
            out.push_back(std::isfinite(value) ? Json(value) : Json(nullptr));
        return out;
    }
    if (is_even(values)) {
        const double step = (values.back() - values.front()) / static_cast<double>(values.size() - 1);
        return {{"from", values.front()}, {"step", step}, {"count", values.size()}};
    }
    return in_steps(values);
}

std::string chart_text(const Chart& chart) {
    Json out{{"name", chart.name}, {"title", chart.title}};
    if (!chart.choice.empty()) out["choice"] = chart.choice;
    out["views"] = Json::array();
    for (const ChartView& view : chart.views) {
        Json layers = Json::array();
        for (const ChartLayer& layer : view.layers)
            layers.push_back(layer_json(layer));
        out["views"].push_back({{"label", view.label},
                                {"height", view.height},
                                {"x", axis_json(view.x)},
                                {"y", axis_json(view.y)},
                                {"layers", std::move(layers)}});
    }
    const std::string text = out.dump(-1, ' ', false, Json::error_handler_t::replace);
    // A script element ends at the first "</", a comment in it begins with "<!": neither may come from a name.
    std::string safe;
    safe.reserve(text.size());
    for (const char c : text) {
        if (c == '<')
            safe += "\\u003c";
        else
            safe += c;
    }
    return safe;
}

}  // namespace orbid::apps
