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
    std::vector<SummaryTable::Column> columns{left_aligned("stage"), left_aligned("status"), "iterations", "objective"};
    if (stages.empty()) return "";
    const Json& parameters = block_at(stages.back(), "parameters");
    for (const auto& [name, entry] : parameters.items()) {
        columns.push_back({name});
        columns.push_back({"± " + name});
    }
    SummaryTable table(columns);
    for (const Json& stage : stages) {
        SummaryTable::Row cells{text_at(stage, "stage") + (stage.value("chosen", false) ? " (chosen)" : ""),
                                text_at(stage, "status"), significant(number_at(stage, "iterations"), 9),
                                number_cell(number_at(stage, "objective"), 8)};
        for (const auto& [name, entry] : parameters.items()) {
            const Json& found = block_at(block_at(stage, "parameters"), name);
            const double sd = number_at(found, "sd");
            cells.push_back(found.empty() ? "" : estimate_cell(number_at(found, "value"), sd));
            cells.push_back(number_cell(sd, 2));
        }
        table.add(std::move(cells));
    }
    return html_table("Stages of the estimate", table);
}

std::string matching_html(const Json& list) {
    SummaryTable table({left_aligned("experiment"), left_aligned("coordinate"), "intervals", "sd allowed", "rms",
                        left_aligned("unit"), explained("large defects", "intervals that the model does not carry")});
    std::string remarks;
    for (const Json& matching : list) {
        const double large = number_at(matching, "large_defects");
        for (const auto& [name, entry] : block_at(matching, "coordinates").items())
            table.add({text_at(matching, "experiment"), name, significant(number_at(matching, "intervals"), 9),
                       number_cell(number_at(entry, "sd"), 3), number_cell(number_at(entry, "rms"), 3),
                       text_at(entry, "unit"), number_cell(large, 9, large > 0.0 ? "caution" : "")});
        for (const Json& warning : block_at(matching, "warnings"))
            remarks += html_paragraph(warning.is_string() ? warning.get<std::string>() : "");
    }
    return html_table("Matching: how far the model's trajectory jumps at the nodes between readings", table) + remarks;
}

std::string noise_html(const Json& list) {
    SummaryTable table({left_aligned("experiment"), left_aligned("coordinate"), "diffusion", "sd", "from", "to",
                        left_aligned("unit"), left_aligned("")});
    for (const Json& matching : list)
        for (const auto& [name, entry] : block_at(matching, "diffusion").items()) {
            const Json& interval = block_at(entry, "interval95");
            const auto end = [&](std::size_t i) {
                return interval.is_array() && interval.size() == 2 && interval[i].is_number()
                           ? significant(interval[i].get<double>(), 3)
                           : std::string();
            };
            table.add({text_at(matching, "experiment"), name, number_cell(number_at(entry, "value"), 4),
                       number_cell(number_at(entry, "sd"), 2), end(0), end(1), text_at(entry, "unit"),
                       text_at(entry, "at_bound").empty() ? "" : "at its bound: no process noise is found"});
        }
    return html_table("Process noise: white noise that disturbs the model, dv = f dt + sqrt(diffusion) dW", table);
}

std::string score_text(const Json& entry) {
    const Json& score = block_at(entry, "held_out");
    const double value = number_at(score, "value");
    return std::isfinite(value) ? fmt::format("{:.1f} ± {:.1f}", value, number_at(score, "sd"))
                                : text_at(score, "reason");
}

std::string criticism_html(const Json& criticism) {
    SummaryTable table(
        {left_aligned("model"), left_aligned("status"),
         explained("ln Bayes factor", "of the job's model over this one: above 5 is very strong"),
         left_aligned("verdict"), "large defects",
         explained(left_aligned("held out"), "log density of data that took no part in the fit: more is better"),
         left_aligned("remark")});
    table.add({text_at(criticism, "model") + " (the job's)", "", "", "",
               significant(number_at(criticism, "large_defects"), 9), score_text(criticism), ""});
    for (const Json& alternative : block_at(criticism, "alternatives")) {
        const Json& factor = block_at(alternative, "ln_bayes_factor");
        const std::string reason = text_at(factor, "reason");
        table.add({text_at(alternative, "model"), text_at(alternative, "status"),
                   formatted_cell("{:.1f}", number_at(factor, "value")), text_at(alternative, "verdict"),
                   significant(number_at(alternative, "large_defects"), 9), score_text(alternative),
                   reason.empty() ? text_at(alternative, "message") : reason});
    }
    return html_table("Models side by side", table);
}

}  // namespace

ReportChapter course_chapter(const ReportSource& source) {
    ReportChapter chapter{"course", "Course of the estimate", ""};
    if (!source.run.result) return chapter;
    const Json& result = *source.run.result;
    if (const Json& stages = block_at(result, "stages"); !stages.empty())
        chapter.html +=
            html_headed(3, "Stages",
                        figure_html(stage_chart(source.run),
                                    "What each stage said of a parameter, with its 95 % interval. Intervals "
                                    "of later stages should lie within those of earlier ones.") +
                            stages_table(stages));
    chapter.html += html_headed(
        3, "Convergence",
        figure_html(convergence_chart(source.run),
                    "The objective before each step, above the value it ended at. A steep fall at the end is the "
                    "convergence of Gauss and Newton."));
    chapter.html += html_headed(3, "Matching", matching_html(block_at(result, "matching")));
    chapter.html += html_headed(3, "Process noise", noise_html(block_at(result, "matching")));
    if (const Json& criticism = block_at(result, "criticism"); !criticism.empty())
        chapter.html +=
            html_headed(3, "Other models",
                        figure_html(evidence_chart(source.run), "What the data say of each model against the job's.") +
                            criticism_html(criticism));
    return chapter;
}

}  // namespace orbid::apps
