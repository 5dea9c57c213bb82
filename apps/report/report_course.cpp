#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "apps/report/html_text.hpp"
#include "apps/report/report_chapter.hpp"
#include "apps/results/summary_table.hpp"

namespace orbid::apps {

namespace {

using namespace detail;

/// The objective after each accepted step, above its last value: a logarithmic course shows every step.
Chart convergence_chart(const Json& history) {
    Chart chart{"convergence", "Objective after each step", "Block", {}};
    for (const std::string block : {"theta", "scales"}) {
        ChartLayer line{"line", "", 1, ""};
        ChartLayer points{"points", "accepted step", 1, ""};
        ChartLayer refused{"points", "refused step", 2, ""};
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
            layer.x.push_back(number - 1.0);
            layer.y.push_back(above);
            const double damping = number_at(step, "damping");
            layer.labels.push_back(
                fmt::format("step {}, round {}{}{}", number, significant(number_at(step, "round"), 9),
                            damping > 0.0 ? fmt::format(", damping {:.2g}", damping) : std::string(),
                            text_at(step, "reason").empty() ? std::string() : ": " + text_at(step, "reason")));
            if (accepted) {
                line.x.push_back(number - 1.0);
                line.y.push_back(above);
            }
            range.include(above);
        }
        if (points.x.size() < 2) continue;
        ChartView view;
        view.label = block == "theta" ? "parameters" : "error parameters";
        view.x = {"step", "", -0.5, number - 0.5};
        view.x.whole = true;
        view.y = range.axis("objective above its last value", "", true);
        view.height = 0.42;
        view.layers = {std::move(line), std::move(points)};
        if (!refused.x.empty()) view.layers.push_back(std::move(refused));
        chart.views.push_back(std::move(view));
    }
    return chart;
}

/// What each stage said of the parameters, against what the last one says, in its standard deviations.
Chart stage_chart(const Json& stages) {
    Chart chart{"stages", "Parameters after each stage, relative to the last", "Parameter", {}};
    const Json* last = filled(stages.back(), "parameters");
    if (stages.size() < 2 || last == nullptr) return chart;
    for (const auto& [name, final_entry] : last->items()) {
        ChartView view;
        std::vector<std::string> names;
        ChartLayer values{"points", "estimate", 2, ""};
        ChartLayer intervals{"intervals", "95 % interval", 2, ""};
        ChartRange range;
        for (const Json& stage : stages) {
            const auto height = static_cast<double>(names.size());
            names.push_back(text_at(stage, "stage"));
            const Json* entry = filled(filled(stage, "parameters"), name);
            if (entry == nullptr) continue;
            values.x.push_back(number_at(*entry, "value"));
            values.y.push_back(height);
            values.labels.push_back(text_at(stage, "stage"));
            range.include(values.x.back());
            const Json* ends = filled(*entry, "interval95");
            if (ends == nullptr || !(*ends)[0].is_number() || !(*ends)[1].is_number()) continue;
            intervals.lower.push_back((*ends)[0].get<double>());
            intervals.upper.push_back((*ends)[1].get<double>());
            intervals.y.push_back(height);
            range.include(intervals.lower.back());
            range.include(intervals.upper.back());
        }
        if (values.x.size() < 2) continue;
        view.label = name;
        view.x = range.axis(name, text_at(final_entry, "unit"));
        const double reference = number_at(final_entry, "reference");
        if (std::isfinite(reference)) {
            ChartLayer rule{"rule", "reference", 1, "ink"};
            rule.at_x = reference;
            view.layers.push_back(std::move(rule));
        }
        view.layers.push_back(std::move(intervals));
        view.layers.push_back(std::move(values));
        name_lines(view, std::move(names));
        chart.views.push_back(std::move(view));
    }
    return chart;
}

std::string stages_table(const Json& stages) {
    std::vector<HtmlTable::Column> columns{{"stage", false}, {"status", false}, {"iterations"}, {"objective"}};
    const Json* parameters = filled(stages.back(), "parameters");
    if (parameters != nullptr) {
        for (const auto& [name, entry] : parameters->items()) {
            columns.push_back({name});
            columns.push_back({"± " + name});
        }
    }
    HtmlTable table("Stages of the estimate", columns);
    for (const Json& stage : stages) {
        const double objective = number_at(stage, "objective");
        std::vector<HtmlTable::Cell> cells{text_at(stage, "stage") + (stage.value("chosen", false) ? " (chosen)" : ""),
                                           text_at(stage, "status"),
                                           significant(number_at(stage, "iterations"), 9),
                                           {significant(objective, 8), objective}};
        const Json* own = filled(stage, "parameters");
        if (parameters != nullptr) {
            for (const auto& [name, entry] : parameters->items()) {
                const Json* found = filled(own, name);
                const bool known = found != nullptr;
                const double sd = known ? number_at(*found, "sd") : std::nan("");
                const double value = known ? number_at(*found, "value") : std::nan("");
                cells.emplace_back(known ? with_digits_of(value, sd) : "", value);
                cells.emplace_back(significant(sd, 2), sd);
            }
        }
        table.add(std::move(cells));
    }
    return table.html();
}

std::string matching_html(const Json& list) {
    HtmlTable table("Matching: how far the model's trajectory jumps at the nodes between readings",
                    {{"experiment", false},
                     {"coordinate", false},
                     {"intervals"},
                     {"sd allowed"},
                     {"rms"},
                     {"unit", false},
                     {"large defects", true, "intervals that the model does not carry"}});
    std::string remarks;
    for (const Json& matching : list) {
        if (const Json* coordinates = filled(matching, "coordinates")) {
            for (const auto& [name, entry] : coordinates->items()) {
                const auto cell = [&values = entry](const char* key) {
                    return HtmlTable::Cell(significant(number_at(values, key), 3), number_at(values, key));
                };
                const double large = number_at(matching, "large_defects");
                table.add({text_at(matching, "experiment"),
                           name,
                           significant(number_at(matching, "intervals"), 9),
                           cell("sd"),
                           cell("rms"),
                           text_at(entry, "unit"),
                           {significant(large, 9), large, large > 0.0 ? "caution" : ""}});
            }
        }
        if (const Json* warnings = filled(matching, "warnings")) {
            for (const Json& warning : *warnings)
                remarks += html_paragraph(warning.is_string() ? warning.get<std::string>() : "");
        }
    }
    return table.html() + remarks;
}

std::string score_text(const Json& entry) {
    const Json* score = filled(entry, "held_out");
    if (score == nullptr) return "";
    const double value = number_at(*score, "value");
    return std::isfinite(value) ? fmt::format("{:.1f} ± {:.1f}", value, number_at(*score, "sd"))
                                : text_at(*score, "reason");
}

std::string criticism_html(const Json& criticism) {
    HtmlTable table("Models side by side",
                    {{"model", false},
                     {"status", false},
                     {"ln Bayes factor", true, "of the job's model over this one: above 5 is very strong"},
                     {"verdict", false},
                     {"large defects"},
                     {"held out", false, "log density of data that took no part in the fit: more is better"},
                     {"remark", false}});
    table.add({text_at(criticism, "model") + " (the job's)", "", "", "",
               significant(number_at(criticism, "large_defects"), 9), score_text(criticism), ""});
    if (const Json* alternatives = filled(criticism, "alternatives")) {
        for (const Json& alternative : *alternatives) {
            const Json* factor = filled(alternative, "ln_bayes_factor");
            const double value = factor == nullptr ? std::nan("") : number_at(*factor, "value");
            const std::string reason = factor == nullptr ? "" : text_at(*factor, "reason");
            table.add({text_at(alternative, "model"),
                       text_at(alternative, "status"),
                       {std::isfinite(value) ? fmt::format("{:.1f}", value) : "", value},
                       text_at(alternative, "verdict"),
                       significant(number_at(alternative, "large_defects"), 9),
                       score_text(alternative),
                       reason.empty() ? text_at(alternative, "message") : reason});
        }
    }
    return table.html();
}

}  // namespace

ReportChapter course_chapter(const ReportSource& source) {
    ReportChapter chapter{"course", "Course of the estimate", ""};
    if (!source.run.result) return chapter;
    const Json& result = *source.run.result;
    if (const Json* stages = filled(result, "stages"))
        chapter.html +=
            html_headed(3, "Stages",
                        figure_html(source, stage_chart(*stages),
                                    "What each stage said of a parameter, with its 95 % interval. Intervals "
                                    "of later stages should lie within those of earlier ones.") +
                            stages_table(*stages));
    if (const Json* history = filled(result, "history"))
        chapter.html += html_headed(
            3, "Convergence",
            figure_html(source, convergence_chart(*history),
                        "The objective before each step, above the value it ended at. A steep fall at the end is the "
                        "convergence of Gauss and Newton."));
    if (const Json* matching = filled(result, "matching"))
        chapter.html += html_headed(3, "Matching", matching_html(*matching));
    if (const Json* criticism = filled(result, "criticism")) {
        Chart evidence{"evidence", "", "", {}};
        chapter.html +=
            html_headed(3, "Other models",
                        figure_html(source, evidence, "What the data say of each model against the job's.") +
                            criticism_html(*criticism));
    }
    return chapter;
}

}  // namespace orbid::apps
