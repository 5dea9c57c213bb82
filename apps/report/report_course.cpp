#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "apps/report/html_text.hpp"
#include "apps/report/plots/run_charts.hpp"
#include "apps/report/report_chapter.hpp"
#include "apps/results/summary_table.hpp"

namespace orbid::apps {

namespace {

using namespace detail;

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
                                           text_at(stage, "status"), significant(number_at(stage, "iterations"), 9),
                                           number_cell(objective, 8)};
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
                const double large = number_at(matching, "large_defects");
                table.add({text_at(matching, "experiment"), name, significant(number_at(matching, "intervals"), 9),
                           number_cell(number_at(entry, "sd"), 3), number_cell(number_at(entry, "rms"), 3),
                           text_at(entry, "unit"), number_cell(large, 9, large > 0.0 ? "caution" : "")});
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
                        figure_html(stage_chart(source.run),
                                    "What each stage said of a parameter, with its 95 % interval. Intervals "
                                    "of later stages should lie within those of earlier ones.") +
                            stages_table(*stages));
    chapter.html += html_headed(
        3, "Convergence",
        figure_html(convergence_chart(source.run),
                    "The objective before each step, above the value it ended at. A steep fall at the end is the "
                    "convergence of Gauss and Newton."));
    if (const Json* matching = filled(result, "matching"))
        chapter.html += html_headed(3, "Matching", matching_html(*matching));
    if (const Json* criticism = filled(result, "criticism"))
        chapter.html +=
            html_headed(3, "Other models",
                        figure_html(evidence_chart(source.run), "What the data say of each model against the job's.") +
                            criticism_html(*criticism));
    return chapter;
}

}  // namespace orbid::apps
