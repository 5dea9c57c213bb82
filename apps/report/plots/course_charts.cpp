#include <cmath>
#include <vector>

#include <fmt/format.h>

#include "apps/report/plots/run_charts.hpp"
#include "apps/results/summary_table.hpp"

/// Charts of the way to the estimate: steps and stages.
namespace orbid::apps {

namespace {

using namespace detail;

std::string step_words(const Json& step, double number) {
    const double damping = number_at(step, "damping");
    const std::string reason = text_at(step, "reason");
    return fmt::format("step {}, round {}{}{}", number, significant(number_at(step, "round"), 9),
                       damping > 0.0 ? fmt::format(", damping {:.2g}", damping) : std::string(),
                       reason.empty() ? std::string() : ": " + reason);
}

/// The objective before each accepted step of a block, above its last value: a logarithmic course shows every step.
/// No layers where there is none.
ChartView steps_view(const Json& history, const std::string& block) {
    ChartLayer line{LayerKind::line, "", 1};
    ChartLayer points{LayerKind::points, "accepted step", 1};
    ChartLayer refused{LayerKind::points, "refused step", 2};
    refused.open = true;
    double last = std::nan("");
    for (const Json& step : history)
        if (text_at(step, "block") == block && step.value("accepted", false)) last = number_at(step, "after");
    // Below this the objective only rounds.
    const double rounding = 1e-12 * std::max(1.0, std::abs(last));
    ChartRange range;
    double number = 0.0;
    for (const Json& step : history) {
        if (text_at(step, "block") != block) continue;
        number += 1.0;
        const bool accepted = step.value("accepted", false);
        const double above = std::max(rounding, number_at(step, accepted ? "before" : "after") - last);
        if (!std::isfinite(above)) continue;
        ChartLayer& layer = accepted ? points : refused;
        layer.add(number - 1.0, above);
        layer.labels.push_back(step_words(step, number));
        if (accepted) line.add(number - 1.0, above);
        range.include(above);
    }
    ChartView view;
    if (points.x.empty()) return view;
    view.label = block == "theta" ? "parameters" : "error parameters";
    view.x = {"step", "", -0.5, number - 0.5};
    view.x.whole = true;
    view.y = range.axis("objective − last", "", true);
    view.height = 0.42;
    view.layers = {std::move(line), std::move(points)};
    view.add(std::move(refused));
    return view;
}

/// How far each parameter was from the result, in its sds, at the start and after each stage.
ChartView distances_view(const Json& parameters, const Json& stages) {
    ChartView view;
    view.label = "stages";
    view.x = {"", "", -0.4, static_cast<double>(stages.size()) + 0.4};
    view.x.names = {"start"};
    for (const Json& stage : stages)
        view.x.names.push_back(text_at(stage, "stage"));
    ChartRange range;
    int style = 0;
    for (const auto& [name, entry] : parameters.items()) {
        style = style % 8 + 1;
        ChartLayer line{LayerKind::line, display_name(name), style};
        const auto add = [&, &final_entry = entry](double value) {
            const double distance = std::abs(value - number_at(final_entry, "value")) / number_at(final_entry, "sd");
            // The result itself has distance 0, which a logarithm does not show.
            line.add(static_cast<double>(line.x.size()), distance > 0.0 ? distance : std::nan(""));
        };
        add(number_at(entry, "start"));
        for (const Json& stage : stages)
            add(number_at(block_at(block_at(stage, "parameters"), name), "value"));
        range.include(line.y);
        ChartLayer points = line;
        points.kind = LayerKind::points;
        view.layers.push_back(std::move(line));
        view.layers.push_back(std::move(points));
    }
    if (range.empty()) return {};
    range.include(1.0);
    view.y = range.axis("|deviation| / sd", "", true);
    view.height = 0.42;
    view.layers.push_back(level_rule(1.0, "", Ink::soft, true));
    return view;
}

/// What each stage said of one parameter.
ChartView stages_view(const Json& stages, const std::string& name, const Json& final_entry) {
    ChartView view;
    std::vector<std::string> names;
    ChartLayer values{LayerKind::points, "estimate", 2};
    ChartLayer intervals{LayerKind::intervals, "95 % interval", 2};
    ChartRange range;
    for (const Json& stage : stages) {
        const auto height = static_cast<double>(names.size());
        names.push_back(text_at(stage, "stage"));
        const Json& entry = block_at(block_at(stage, "parameters"), name);
        if (entry.empty()) continue;
        values.add(number_at(entry, "value"), height);
        values.labels.push_back(text_at(stage, "stage"));
        intervals.lower.push_back(interval_end(entry, 0));
        intervals.upper.push_back(interval_end(entry, 1));
        intervals.y.push_back(height);
    }
    if (values.x.size() < 2) return view;
    for (const auto* list : {&values.x, &intervals.lower, &intervals.upper})
        range.include(*list);
    view.label = name;
    view.x = range.axis(display_name(name), text_at(final_entry, "unit"));
    const double reference = number_at(final_entry, "reference");
    if (std::isfinite(reference)) view.layers.push_back(upright_rule(reference, "reference", Ink::ink));
    view.add(std::move(intervals));
    view.add(std::move(values));
    name_lines(view, std::move(names));
    return view;
}

}  // namespace

Chart convergence_chart(const StoredRun& run) {
    Chart chart{"convergence", "Objective after each step", "Block", {}, Chart::Arrangement::stacked};
    const Json& history = block_at(run.result, "history");
    for (const char* block : {"theta", "scales"})
        chart.add(steps_view(history, block));
    if (chart.views.empty()) return chart;
    const Json& stages = block_at(run.result, "stages");
    if (!stages.empty()) chart.add(distances_view(block_at(run.result, "parameters"), stages));
    const auto refused =
        std::count_if(history.begin(), history.end(), [](const Json& step) { return !step.value("accepted", false); });
    chart.description = fmt::format("{} steps of the minimisation, {} of them refused", history.size(), refused);
    return chart;
}

Chart stage_chart(const StoredRun& run) {
    Chart chart{
        "stages", "Parameters after each stage, relative to the last", "Parameter", {}, Chart::Arrangement::tiles};
    const Json& stages = block_at(run.result, "stages");
    if (stages.size() < 2) return chart;
    for (const auto& [name, entry] : block_at(stages.back(), "parameters").items())
        chart.add(stages_view(stages, name, entry));
    chart.description = fmt::format("{} parameters after each of {} stages", chart.views.size(), stages.size());
    return chart;
}

}  // namespace orbid::apps
