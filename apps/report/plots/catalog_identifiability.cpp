#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "apps/drawing/figure.hpp"
#include "apps/report/plots/catalog_plots.hpp"
#include "apps/results/summary_table.hpp"

/// How the estimate was reached, what the data determine, and what speaks for other models.
namespace orbid::apps::catalog {

namespace {

using Json = StoredRun::Json;

/// Axis of counted things: 1, 2, ... with a tick at each where there is room.
PlotAxis counting_axis(const std::string& label, std::size_t count, std::size_t first) {
    PlotAxis axis;
    axis.lower = static_cast<double>(first) - 0.6;
    axis.upper = static_cast<double>(first + count) - 0.4;
    axis.label = label;
    constexpr std::size_t most = 10;
    const std::size_t step = (count + most - 1) / most;
    for (std::size_t k = first; k < first + count; k += std::max<std::size_t>(1, step))
        axis.ticks.push_back({static_cast<double>(k), std::to_string(k)});
    return axis;
}

/// How far each parameter was from the result, in its sds, at the start and after each stage.
void draw_stages(Figure& figure, const StoredRun& run) {
    const Json& result = *run.result;
    const Json& stages = result["stages"];
    std::vector<LegendEntry> legend;
    std::vector<std::vector<double>> distances;
    double lowest = std::numeric_limits<double>::infinity();
    double highest = 0.0;
    for (const auto& [name, entry] : result["parameters"].items()) {
        const double value = number(entry, "value");
        const double sd = number(entry, "sd");
        std::vector<double> distance{std::abs(number(entry, "start") - value) / sd};
        for (const Json& stage : stages) {
            const bool known = stage.contains("parameters") && stage["parameters"].contains(name);
            distance.push_back(known ? std::abs(number(stage["parameters"][name], "value") - value) / sd
                                     : std::numeric_limits<double>::quiet_NaN());
        }
        for (double& one : distance) {
            // The result itself has distance 0, which a logarithm does not show.
            if (!(one > 0.0)) one = std::numeric_limits<double>::quiet_NaN();
            if (!std::isfinite(one)) continue;
            lowest = std::min(lowest, one);
            highest = std::max(highest, one);
        }
        legend.push_back({quantity_name(name),
                          LegendEntry::Kind::marker,
                          series_marker(distances.size(), 0.26 * figure.font()),
                          {}});
        distances.push_back(std::move(distance));
    }
    if (!(highest > 0.0)) return;
    figure.legend(legend);
    PlotAxis x;
    x.lower = -0.4;
    x.upper = static_cast<double>(stages.size()) + 0.4;
    x.ticks.push_back({0.0, "start"});
    for (std::size_t k = 0; k < stages.size(); ++k)
        x.ticks.push_back({static_cast<double>(k + 1), stages[k].value("stage", std::to_string(k + 1))});
    Panel panel(figure, figure.row(0.5 * figure.width()), x,
                logarithmic_axis("|deviation from the result| / sd", "", std::min(0.5 * lowest, 0.1), 3.0 * highest));
    panel.open();
    panel.horizontal(1.0, {"#39424f", 0.6, "3 2"});
    for (std::size_t p = 0; p < distances.size(); ++p) {
        std::vector<double> at;
        for (std::size_t k = 0; k < distances[p].size(); ++k)
            at.push_back(static_cast<double>(k));
        const PlotMarker marker = series_marker(p, 0.26 * figure.font());
        panel.curve(at, distances[p], {marker.colour, 0.7});
        panel.markers(at, distances[p], marker);
    }
    panel.frame();
}

}  // namespace

bool has_convergence(const StoredRun& run) {
    if (!run.result || !run.result->contains("history")) return false;
    const Json& history = (*run.result)["history"];
    return std::any_of(history.begin(), history.end(), [](const Json& step) {
        return step.value("accepted", false) && number(step, "before") > number(step, "after");
    });
}

std::string convergence(const StoredRun& run, const PlotStyle& style) {
    const Json& history = (*run.result)["history"];
    Figure figure(style);
    figure.title(run.title());
    struct Steps {
        std::string block;
        std::vector<double> x;
        std::vector<double> y;
    };
    std::vector<Steps> blocks;
    std::vector<double> rejected;
    std::vector<double> rounds;
    double lowest = std::numeric_limits<double>::infinity();
    double highest = 0.0;
    int round = 0;
    for (std::size_t k = 0; k < history.size(); ++k) {
        const Json& step = history[k];
        const auto at = static_cast<double>(k + 1);
        if (k > 0 && step.value("round", 0) != round) rounds.push_back(at - 0.5);
        round = step.value("round", 0);
        if (!step.value("accepted", false)) {
            rejected.push_back(at);
            continue;
        }
        const auto block = step.value("block", std::string());
        auto steps = std::find_if(blocks.begin(), blocks.end(), [&](const Steps& one) { return one.block == block; });
        if (steps == blocks.end()) steps = blocks.insert(blocks.end(), Steps{block, {}, {}});
        const double decrease = number(step, "before") - number(step, "after");
        if (!(decrease > 0.0)) continue;
        steps->x.push_back(at);
        steps->y.push_back(decrease);
        lowest = std::min(lowest, decrease);
        highest = std::max(highest, decrease);
    }
    const double radius = 0.27 * figure.font();
    std::vector<LegendEntry> legend;
    for (std::size_t b = 0; b < blocks.size(); ++b) {
        const std::string words = blocks[b].block == "theta"    ? "parameters"
                                  : blocks[b].block == "scales" ? "error scales"
                                                                : blocks[b].block;
        legend.push_back({words, LegendEntry::Kind::marker, series_marker(b, radius), {}});
    }
    if (!rejected.empty()) legend.push_back({"step refused", LegendEntry::Kind::line, {}, {"#7e8b9f", 1.2}});
    figure.legend(legend);
    // Decreases below this are rounding of the objective.
    constexpr double rounding = 1e-8;
    const auto ends = spared_logarithmically(std::min(std::max(lowest, rounding), 0.1 * highest), highest);
    Panel panel(figure, figure.row(0.55 * figure.width()), counting_axis("step", history.size(), 1),
                logarithmic_axis("decrease of the objective", "", ends[0], ends[1]));
    panel.open();
    for (const double at : rounds)
        panel.vertical(at, {"#b4bcc8", 0.5, "2 2"});
    for (const double at : rejected) {
        const double x = panel.x(at);
        figure.line(x, panel.box().bottom, x, panel.box().bottom - 0.6 * figure.font(), {"#7e8b9f", 1.2});
    }
    for (std::size_t b = 0; b < blocks.size(); ++b)
        panel.markers(blocks[b].x, blocks[b].y, series_marker(b, radius));
    panel.frame();
    if (run.result->contains("stages")) draw_stages(figure, run);
    return figure.svg("Convergence",
                      fmt::format("{} steps of the minimisation, {} of them refused", history.size(), rejected.size()));
}

bool has_singular_values(const StoredRun& run) {
    const auto pointer = Json::json_pointer("/identifiability/singular_values");
    return run.result && run.result->contains(pointer) && run.result->at(pointer).size() >= 2;
}

std::string singular_values(const StoredRun& run, const PlotStyle& style) {
    const Json& block = (*run.result)["identifiability"];
    std::vector<double> x;
    std::vector<double> y;
    double lowest = std::numeric_limits<double>::infinity();
    double highest = 0.0;
    for (const Json& value : block["singular_values"]) {
        x.push_back(static_cast<double>(x.size() + 1));
        y.push_back(value.is_number() ? value.get<double>() : std::numeric_limits<double>::quiet_NaN());
        if (!(y.back() > 0.0)) continue;
        lowest = std::min(lowest, y.back());
        highest = std::max(highest, y.back());
    }
    Figure figure(style);
    figure.title(run.title());
    const auto ends = spared_logarithmically(0.6 * lowest, highest);
    Panel panel(figure, figure.row(0.55 * figure.width()), counting_axis("direction", x.size(), 1),
                logarithmic_axis("singular value", "", ends[0], ends[1]));
    panel.open();
    for (std::size_t k = 0; k < x.size(); ++k)
        if (y[k] > 0.0) figure.line(panel.x(x[k]), panel.box().bottom, panel.x(x[k]), panel.y(y[k]), {"#b4bcc8", 1.0});
    panel.markers(x, y, series_marker(1, 0.3 * figure.font()));
    panel.frame();
    std::string description = fmt::format("singular values from {:.3g} to {:.3g}", highest, lowest);
    for (const Json& direction : block["null_directions"]) {
        std::string words;
        for (const auto& [name, component] : direction.items())
            words +=
                fmt::format("{}{} {:+.2g}", words.empty() ? "" : ", ", quantity_name(name), component.get<double>());
        description += "; not determined: " + words;
        const PageBox row = figure.row(1.4 * figure.font());
        figure.text(0.7 * figure.font(), row.top + figure.font(), "not determined: " + words, {"start", 0.9});
    }
    return figure.svg("Singular values", description);
}

bool has_evidence(const StoredRun& run) {
    const auto pointer = Json::json_pointer("/criticism/alternatives");
    if (!run.result || !run.result->contains(pointer)) return false;
    const Json& list = run.result->at(pointer);
    return std::any_of(list.begin(), list.end(), [](const Json& one) {
        return one.contains("ln_bayes_factor") && std::isfinite(number(one["ln_bayes_factor"], "value"));
    });
}

std::string evidence(const StoredRun& run, const PlotStyle& style) {
    struct Row {
        std::string name;
        std::string verdict;
        double value;
    };
    std::vector<Row> rows;
    double lowest = -6.0;
    double highest = 6.0;
    for (const Json& one : run.result->at(Json::json_pointer("/criticism/alternatives"))) {
        const double value = number(one["ln_bayes_factor"], "value");
        if (!std::isfinite(value)) continue;
        rows.push_back({one.value("model", std::string()), one.value("verdict", std::string()), value});
        lowest = std::min(lowest, 1.1 * value);
        highest = std::max(highest, 1.1 * value);
    }
    Figure figure(style);
    figure.title(run.title());
    double names = 0.0;
    for (const Row& row : rows)
        names = std::max(names, figure.width_of(row.name));
    PlotAxis y;
    y.lower = static_cast<double>(rows.size()) - 0.5;
    y.upper = -0.5;
    Panel panel(figure, figure.row(2.6 * figure.font() * static_cast<double>(rows.size()) + 3.5 * figure.font()),
                linear_axis("ln Bayes factor of the model against it", "", lowest, highest), y,
                {true, false, true, names + 1.4 * figure.font()});
    panel.open();
    // Within 1 the data hardly tell them apart, beyond 5 very strongly (Kass and Raftery 1995).
    figure.rectangle({panel.x(-5.0), panel.box().top, panel.x(5.0), panel.box().bottom}, "#f1f3f6");
    figure.rectangle({panel.x(-1.0), panel.box().top, panel.x(1.0), panel.box().bottom}, "#dfe3ea");
    panel.vertical(0.0, {"#39424f", 0.6});
    for (std::size_t k = 0; k < rows.size(); ++k) {
        const double at = panel.y(static_cast<double>(k));
        const double half = 0.5 * figure.font();
        figure.rectangle({std::min(panel.x(0.0), panel.x(rows[k].value)), at - half,
                          std::max(panel.x(0.0), panel.x(rows[k].value)), at + half},
                         rows[k].value >= 0.0 ? "#0072b2" : "#e69f00");
    }
    panel.frame();
    std::string description;
    for (std::size_t k = 0; k < rows.size(); ++k) {
        figure.text(panel.box().left - 0.6 * figure.font(), panel.y(static_cast<double>(k)) + 0.34 * figure.font(),
                    rows[k].name, {"end"});
        description += fmt::format("{}{}: ln B = {}, {}", k == 0 ? "" : "; ", rows[k].name,
                                   significant(rows[k].value, 4), rows[k].verdict);
    }
    return figure.svg("Evidence", description);
}

}  // namespace orbid::apps::catalog
