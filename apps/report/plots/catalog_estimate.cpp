#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "apps/drawing/figure.hpp"
#include "apps/report/plots/catalog_plots.hpp"
#include "apps/results/summary_table.hpp"

namespace orbid::apps::catalog {

namespace {

using Json = StoredRun::Json;

/// One estimated quantity in a row of its own.
struct Row {
    std::string name;
    std::string words;  ///< value with its sd and unit
    double middle;
    double lower;
    double upper;
};

std::vector<std::pair<std::string, const Json*>> quantities(const Json& result) {
    std::vector<std::pair<std::string, const Json*>> list;
    for (const char* block : {"parameters", "derived"}) {
        if (!result.contains(block)) continue;
        for (const auto& [name, entry] : result[block].items())
            list.emplace_back(name, &entry);
    }
    return list;
}

std::string value_words(const Json& entry) {
    const double value = number(entry, "value");
    const double sd = number(entry, "sd");
    const std::string unit = entry.value("unit", std::string());
    std::string words = with_digits_of(value, sd);
    // Two digits of the sd, without a power of ten where the value has none either.
    if (std::isfinite(sd) && sd >= 1.0 && sd < 1e6) {
        const double step = std::pow(10.0, std::max(0.0, std::floor(std::log10(sd)) - 1.0));
        words += fmt::format(" ± {:.{}f}", std::round(sd / step) * step, sd < 10.0 ? 1 : 0);
    } else if (std::isfinite(sd) && sd > 0.0) {
        words += " ± " + significant(sd, 2);
    }
    return unit.empty() || unit == "1" ? words : words + " " + unit;
}

double interval_end(const Json& entry, std::size_t end) {
    const auto found = entry.find("interval95");
    if (found == entry.end() || !found->is_array() || !found->at(end).is_number())
        return std::numeric_limits<double>::quiet_NaN();
    return found->at(end).get<double>();
}

}  // namespace

bool has_parameters(const StoredRun& run) {
    if (!run.result) return false;
    const auto list = quantities(*run.result);
    return std::any_of(list.begin(), list.end(),
                       [](const auto& entry) { return std::isfinite(interval_end(*entry.second, 0)); });
}

std::string parameters(const StoredRun& run, const PlotStyle& style) {
    const auto list = quantities(*run.result);
    const bool known = std::any_of(list.begin(), list.end(),
                                   [](const auto& entry) { return std::isfinite(number(*entry.second, "reference")); });
    std::vector<Row> rows;
    double reach = 0.0;
    for (const auto& [name, entry] : list) {
        const double value = number(*entry, "value");
        const double sd = number(*entry, "sd");
        const double reference = number(*entry, "reference");
        // In sds from the known value; without any known value, the interval in percent of the estimate.
        const double origin = known ? reference : value;
        const double unit = known ? sd : 0.01 * std::abs(value);
        if (!std::isfinite(origin) || !(unit > 0.0)) continue;
        rows.push_back({quantity_name(name), value_words(*entry), (value - origin) / unit,
                        (interval_end(*entry, 0) - origin) / unit, (interval_end(*entry, 1) - origin) / unit});
        for (const double end : {rows.back().lower, rows.back().middle, rows.back().upper})
            if (std::isfinite(end)) reach = std::max(reach, std::abs(end));
    }
    Figure figure(style);
    figure.title(run.title());
    const double step = 2.0 * figure.font();
    const double range = 1.12 * std::max(reach, known ? 2.6 : 1e-300);
    PlotAxis x = linear_axis(known ? "(estimate − reference) / sd" : "95 % interval around the estimate",
                             known ? "" : "%", -range, range);
    PlotAxis y;
    y.lower = static_cast<double>(rows.size()) - 0.5;
    y.upper = -0.5;
    double names = 0.0;
    double words = 0.0;
    for (const Row& row : rows) {
        names = std::max(names, figure.width_of(row.name));
        words = std::max(words, figure.width_of(row.words, 0.9));
    }
    // The values beside the frame where the page has room for both, below the names otherwise.
    const bool beside = names + words < 0.5 * figure.width();
    PageBox part = figure.row(step * static_cast<double>(rows.size()) * (beside ? 1.0 : 1.4) + 3.5 * figure.font());
    if (beside) part.right -= words + 0.2 * figure.font();
    Panel panel(figure, part, x, y, {true, false, true, std::max(names, beside ? 0.0 : words) + 1.4 * figure.font()});
    panel.open();
    if (known) {
        const double left = panel.x(-2.0);
        const double right = panel.x(2.0);
        figure.rectangle({left, panel.box().top, right, panel.box().bottom}, "#eef1f5");
    }
    panel.vertical(0.0, {"#39424f", 0.6});
    for (std::size_t k = 0; k < rows.size(); ++k) {
        const double at = panel.y(static_cast<double>(k));
        const Row& row = rows[k];
        const double cap = 0.28 * figure.font();
        figure.line(panel.x(row.lower), at, panel.x(row.upper), at, {blue, 1.1});
        for (const double end : {row.lower, row.upper})
            figure.line(panel.x(end), at - cap, panel.x(end), at + cap, {blue, 1.1});
        const std::array<double, 1> x_value{row.middle};
        const std::array<double, 1> y_value{static_cast<double>(k)};
        panel.markers(x_value, y_value, PlotMarker{blue, plot_marker(1, 0.05 * figure.font()).outline});
    }
    panel.frame();
    for (std::size_t k = 0; k < rows.size(); ++k) {
        const double at = panel.y(static_cast<double>(k));
        const double left = panel.box().left - 0.6 * figure.font();
        figure.text(left, at + (beside ? 0.34 : -0.1) * figure.font(), rows[k].name, {"end"});
        const TextStyle small{beside ? "start" : "end", 0.9, "#5b6675"};
        if (beside) {
            figure.text(panel.box().right + 0.7 * figure.font(), at + 0.32 * figure.font(), rows[k].words, small);
        } else {
            figure.text(left, at + 0.9 * figure.font(), rows[k].words, small);
        }
    }
    std::string description;
    for (const Row& row : rows)
        description += fmt::format("{}{} = {}", description.empty() ? "" : "; ", row.name, row.words);
    return figure.svg("Parameters", description);
}

bool has_correlation(const StoredRun& run) {
    return run.result && run.result->contains("correlation") && (*run.result)["correlation"]["names"].size() >= 2 &&
           (*run.result)["correlation"]["matrix"].size() >= 2;
}

std::string correlation(const StoredRun& run, const PlotStyle& style) {
    const Json& block = (*run.result)["correlation"];
    std::vector<std::string> names;
    for (const Json& name : block["names"])
        names.push_back(quantity_name(name.get<std::string>()));
    const auto count = static_cast<double>(names.size());
    Figure figure(style);
    figure.title(run.title());
    double widest = 0.0;
    for (const std::string& name : names)
        widest = std::max(widest, figure.width_of(name));
    double room = widest + figure.font();
    const double side = std::min((figure.width() - room - 0.6 * figure.font()) / count, 5.0 * figure.font());
    room += 0.5 * (figure.width() - room - 0.6 * figure.font() - side * count);  // few parameters: in the middle
    // Names wider than their column are turned.
    const bool upright = widest + 0.5 * figure.font() < side;
    const PageBox part = figure.row(side * count + (upright ? 1.8 * figure.font() : widest + 1.2 * figure.font()));
    std::string description;
    // Numbers where they fit; colours and sizes say the same.
    const bool numbers = side > 2.1 * figure.font();
    for (std::size_t i = 0; i < names.size(); ++i) {
        const double top = part.top + 0.2 * figure.font() + side * static_cast<double>(i);
        figure.text(part.left + room - 0.5 * figure.font(), top + 0.5 * side + 0.34 * figure.font(), names[i], {"end"});
        const double column = part.left + room + side * (static_cast<double>(i) + 0.5);
        const double below = part.top + 0.2 * figure.font() + side * count + 0.4 * figure.font();
        if (upright) {
            figure.text(column, below + 0.8 * figure.font(), names[i], {"middle"});
        } else {
            figure.text(column + 0.34 * figure.font(), below, names[i], {"end", 1.0, "#1d2430", false});
        }
        for (std::size_t j = 0; j < names.size(); ++j) {
            const Json& cell = block["matrix"].at(i).at(j);
            const double value = cell.is_number() ? cell.get<double>() : std::numeric_limits<double>::quiet_NaN();
            const double left = part.left + room + side * static_cast<double>(j);
            const double strength = std::isfinite(value) ? std::min(1.0, std::abs(value)) : 0.0;
            // From white to blue (positive) or orange (negative); the sign stands in the number too.
            const auto mix = [strength](int full) { return static_cast<int>(255.0 - strength * (255 - full) + 0.5); };
            const std::string fill = value >= 0.0 ? fmt::format("#{:02x}{:02x}{:02x}", mix(0x2b), mix(0x7b), mix(0xb9))
                                                  : fmt::format("#{:02x}{:02x}{:02x}", mix(0xe0), mix(0x82), mix(0x1e));
            figure.rectangle({left, top, left + side, top + side}, fill, {"#ffffff", 0.8});
            if (numbers) {
                const std::string words = !std::isfinite(value) ? "–"
                                          : i == j              ? "1"
                                                   : fmt::format("{}{:.2f}", value < 0.0 ? "−" : "", std::abs(value));
                figure.text(left + 0.5 * side, top + 0.5 * side + 0.34 * figure.font(), words,
                            {"middle", 0.95, strength > 0.8 ? "#ffffff" : "#1d2430"});
            }
            if (j < i)
                description +=
                    fmt::format("{}{}, {}: {:.3f}", description.empty() ? "" : "; ", names[i], names[j], value);
        }
    }
    return figure.svg("Correlation", description);
}

}  // namespace orbid::apps::catalog
