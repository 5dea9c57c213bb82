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

constexpr std::size_t most_orbits = 2000;  // rows of the table of computed orbits

std::string bifurcations_table(const Json& file) {
    SummaryTable table({"branch", left_aligned("kind"), text_at(file.at("parameter"), "name"),
                        explained("±", "error of the parameter there"), "period", "time [s]"});
    std::size_t number = 0;
    for (const Json& branch : file.at("branches")) {
        for (const Json& point : branch.at("points")) {
            std::string kind = text_at(point, "bifurcation");
            if (kind.empty()) continue;
            std::replace(kind.begin(), kind.end(), '_', ' ');
            const double at = number_at(point, "parameter");
            table.add({std::to_string(number),
                       kind,
                       {fmt::format("{:.12g}", at), at},
                       number_cell(number_at(point, "parameter_error"), 2),
                       point.at("period").dump(),
                       number_cell(number_at(point, "time"), 7)});
        }
        ++number;
    }
    return html_table("Bifurcations", table);
}

std::string cascades_table(const Json& cascades) {
    SummaryTable table(
        {"cascade", "doubling", "parameter", explained("ratio of distances", "tends to Feigenbaum's 4.669")});
    std::size_t number = 0;
    for (const Json& cascade : cascades) {
        const Json& values = cascade.at("parameter");
        const Json& ratios = cascade.at("ratios");
        for (std::size_t k = 0; k < values.size(); ++k) {
            const double ratio = k >= 2 && k - 2 < ratios.size() ? number_of(ratios[k - 2]) : std::nan("");
            table.add({std::to_string(number), std::to_string(k + 1),
                       fmt::format("{:.12g}", values.at(k).get<double>()), number_cell(ratio, 5)});
        }
        ++number;
    }
    return html_table("Period doublings in a row", table);
}

std::string orbits_table(const Json& list) {
    SummaryTable table({"orbit", "period", left_aligned("status"), "largest |multiplier|", "time [s]", "residual",
                        left_aligned("first point")});
    for (std::size_t i = 0; i < std::min(most_orbits, list.size()); ++i) {
        const Json& orbit = list.at(i);
        std::string point;
        if (const Json& points = block_at(orbit, "points"); points.is_array() && !points.empty()) {
            for (const Json& value : points[0])
                append_words(point, value.is_number() ? significant(number_of(value), 8) : "undefined", ", ");
        }
        table.add({std::to_string(i), orbit.at("period").dump(), text_at(orbit, "status"),
                   number_cell(largest_multiplier(orbit), 4), number_cell(number_at(orbit, "time"), 7),
                   number_cell(number_at(orbit, "residual"), 2), point});
    }
    std::string out = html_table("Periodic orbits of the model", table);
    if (list.size() > most_orbits)
        out += html_paragraph(fmt::format("The first {} of {} orbits; the others are in the file.", most_orbits,
                                          detail::grouped(list.size())));
    return out;
}

}  // namespace

ReportChapter branch_chapter(const ReportSource& source) {
    ReportChapter chapter{"orbits", "Orbits of the model", ""};
    if (const Json* branch = source.run.shown_branch(); !block_at(branch, "branches").empty()) {
        const Json& file = *branch;
        std::string caption =
            "Periodic orbits as the parameter moves: stable ones solid, unstable ones dashed, bifurcations marked.";
        if (!block_at(file, "measured").empty())
            caption += " Measured motions with their 95 % intervals: filled where the model's orbit is stable.";
        std::string html = figure_html(branch_chart(source.run), caption);
        html += html_paragraph(text_at(file, "message"));
        html += bifurcations_table(file);
        html += cascades_table(block_at(file, "cascades"));
        chapter.html += html_headed(3, "Branches and bifurcations", html);
    }
    // Orbits of a fit stand beside their cycles in the chapter on the section; these were asked for themselves.
    chapter.html += html_headed(3, "Computed orbits", orbits_table(block_at(source.run.orbits, "cycles")));
    return chapter;
}

}  // namespace orbid::apps
