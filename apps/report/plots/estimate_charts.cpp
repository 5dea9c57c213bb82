#include <array>
#include <cmath>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include "apps/report/plots/run_charts.hpp"
#include "apps/results/summary_table.hpp"

/// Charts of the estimates themselves: their values, what the data determine, what speaks for other models.
namespace orbid::apps {

namespace {

using namespace detail;

/// Parameters and derived quantities by name.
std::vector<std::pair<std::string, const Json*>> estimated_quantities(const Json& result) {
    std::vector<std::pair<std::string, const Json*>> list;
    for (const char* block : {"parameters", "derived"}) {
        for (const auto& [name, entry] : block_at(result, block).items())
            list.emplace_back(name, &entry);
    }
    return list;
}

std::string value_words(const Json& entry) {
    const double value = number_at(entry, "value");
    const double sd = number_at(entry, "sd");
    const std::string unit = text_at(entry, "unit");
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

/// From -reach to reach over the whole height, behind all other layers.
void add_band(ChartView& view, double reach, std::string name) {
    ChartLayer band{LayerKind::band, std::move(name), 1, Ink::soft, {-reach, reach}};
    band.lower.assign(2, view.y.lower);
    band.upper.assign(2, view.y.upper);
    view.layers.insert(view.layers.begin(), std::move(band));
}

/// The squares and names of a matrix of correlations.
ChartView matrix_view(const std::vector<std::string>& names, const Json& matrix, std::string& description) {
    ChartView view;
    ChartLayer cells{LayerKind::cells, "", 1};
    for (std::size_t i = 0; i < names.size(); ++i) {
        for (std::size_t j = 0; j < names.size(); ++j) {
            const double value = number_of(matrix.at(i).at(j));
            cells.add(static_cast<double>(j), static_cast<double>(i));
            cells.shade.push_back(value);
            cells.labels.push_back(!std::isfinite(value) ? "–"
                                   : i == j              ? "1"
                                            : fmt::format("{}{:.2f}", value < 0.0 ? "−" : "", std::abs(value)));
            if (j < i) append_words(description, fmt::format("{}, {}: {:.3f}", names[i], names[j], value));
        }
    }
    view.layers = {std::move(cells)};
    name_lines(view, names);
    view.x.names = names;
    for (ChartAxis* axis : {&view.x, &view.y}) {
        axis->lower = -0.5;
        axis->upper = static_cast<double>(names.size()) - 0.5;
    }
    return view;
}

}  // namespace

bool has_references(const StoredRun& run) {
    if (!run.result) return false;
    const auto list = estimated_quantities(*run.result);
    return std::any_of(list.begin(), list.end(),
                       [](const auto& one) { return std::isfinite(number_at(*one.second, "reference")); });
}

Chart parameter_chart(const StoredRun& run) {
    const bool known = has_references(run);
    Chart chart{"parameters", known ? "Estimates against known values, in standard deviations"
                                    : "Estimates with their intervals, in percent"};
    if (!run.result) return chart;
    const auto list = estimated_quantities(*run.result);
    if (std::none_of(list.begin(), list.end(),
                     [](const auto& one) { return std::isfinite(interval_end(*one.second, 0)); }))
        return chart;
    ChartLayer intervals{LayerKind::intervals, "95 % interval", 2};
    ChartLayer values{LayerKind::points, "estimate", 2};
    ChartView view;
    std::vector<std::string> names;
    for (const auto& [name, entry] : list) {
        const double value = number_at(*entry, "value");
        const double sd = number_at(*entry, "sd");
        // In sds from the known value; without any known value, the interval in percent of the estimate.
        const double origin = known ? number_at(*entry, "reference") : value;
        const double unit = known ? sd : 0.01 * std::abs(value);
        if (!std::isfinite(origin) || !(unit > 0.0)) continue;
        const auto height = static_cast<double>(names.size());
        names.push_back(display_name(name));
        view.y.notes.push_back(value_words(*entry));
        intervals.lower.push_back((interval_end(*entry, 0) - origin) / unit);
        intervals.upper.push_back((interval_end(*entry, 1) - origin) / unit);
        intervals.y.push_back(height);
        values.add((value - origin) / unit, height);
        values.labels.push_back(fmt::format("{} = {}", name, with_digits_of(value, sd)));
        append_words(chart.description, names.back() + " = " + view.y.notes.back());
    }
    if (names.empty()) return chart;
    ChartRange range;
    range.include(intervals.lower);
    range.include(intervals.upper);
    range.include(values.x);
    range.include(0.0);
    view.x = known ? range.axis("(estimate − reference) / sd", "") : range.axis("around the estimate", "%");
    view.layers = {upright_rule(0.0, known ? "reference" : "", Ink::ink), std::move(intervals), std::move(values)};
    name_lines(view, std::move(names));
    if (known) add_band(view, 2.0, "± 2 sd");
    chart.add(std::move(view));
    return chart;
}

Chart correlation_chart(const StoredRun& run) {
    Chart chart{"correlation", "Correlations of the estimates"};
    const Json& correlation = block_at(run.result, "correlation");
    const Json& list = block_at(correlation, "names");
    const Json& matrix = block_at(correlation, "matrix");
    if (list.size() < 2 || matrix.size() != list.size()) return chart;
    std::vector<std::string> names;
    for (const Json& name : list)
        names.push_back(display_name(name.get<std::string>()));
    chart.views.push_back(matrix_view(names, matrix, chart.description));
    return chart;
}

Chart singular_value_chart(const StoredRun& run) {
    Chart chart{"singular_values", "Singular values of the scaled sensitivities"};
    const Json& block = block_at(run.result, "identifiability");
    const Json& values = block_at(block, "singular_values");
    ChartLayer points{LayerKind::points, "", 2};
    ChartRange range;
    for (std::size_t i = 0; i < values.size(); ++i) {
        if (!values.at(i).is_number() || !(values.at(i).get<double>() > 0.0)) continue;
        points.add(static_cast<double>(i + 1), values.at(i).get<double>());
        points.labels.push_back(fmt::format("direction {}", i + 1));
        range.include(points.y.back());
    }
    if (points.x.size() < 2) return chart;
    ChartView view;
    view.x = {"direction", "", 0.4, static_cast<double>(values.size()) + 0.6};
    view.x.whole = true;
    view.y = range.axis("singular value", "", true);
    view.height = 0.4;
    view.layers = {std::move(points)};
    chart.views.push_back(std::move(view));
    chart.description = fmt::format("singular values from {:.3g} to {:.3g}", range.highest, range.lowest);
    for (const Json& direction : block_at(block, "null_directions")) {
        std::string words;
        for (const auto& [name, component] : direction.items())
            append_words(words, fmt::format("{} {:+.2g}", display_name(name), component.get<double>()), ", ");
        chart.remarks.push_back("not determined: " + words);
        append_words(chart.description, chart.remarks.back());
    }
    return chart;
}

Chart evidence_chart(const StoredRun& run) {
    Chart chart{"evidence", "Logarithms of the Bayes factors against other models"};
    ChartView view;
    std::vector<std::string> names;
    ChartRange range;
    range.include(-6.0);
    range.include(6.0);
    // In favour of the job's model, and of the other one.
    std::array sides{ChartLayer{LayerKind::intervals, "for the job's model", 2},
                     ChartLayer{LayerKind::intervals, "for the other one", 4}};
    ChartLayer points{LayerKind::points, "", 7, Ink::ink};
    for (const Json& one : block_at(block_at(run.result, "criticism"), "alternatives")) {
        const double value = number_at(block_at(one, "ln_bayes_factor"), "value");
        if (!std::isfinite(value)) continue;
        const auto height = static_cast<double>(names.size());
        const std::string model = text_at(one, "model");
        const std::string words = fmt::format("ln B = {}, {}", significant(value, 4), text_at(one, "verdict"));
        names.push_back(model);
        ChartLayer& side = sides[value >= 0.0 ? 0 : 1];
        side.lower.push_back(std::min(0.0, value));
        side.upper.push_back(std::max(0.0, value));
        side.y.push_back(height);
        points.add(value, height);
        points.labels.push_back(words);
        range.include(value);
        append_words(chart.description, model + ": " + words);
    }
    if (names.empty()) return chart;
    view.x = range.axis("ln Bayes factor", "");
    view.layers = {upright_rule(0.0, "", Ink::ink)};
    for (ChartLayer* layer : {&sides[0], &sides[1], &points})
        view.add(std::move(*layer));
    name_lines(view, std::move(names));
    // Within 1 the data hardly tell them apart, beyond 5 very strongly (Kass and Raftery 1995).
    add_band(view, 1.0, "");
    add_band(view, 5.0, "");
    chart.add(std::move(view));
    return chart;
}

}  // namespace orbid::apps
