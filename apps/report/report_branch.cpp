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
    HtmlTable table("Bifurcations", {{"branch"},
                                     {"kind", false},
                                     {text_at(file.at("parameter"), "name")},
                                     {"±", true, "error of the parameter there"},
                                     {"period"},
                                     {"time [s]"}});
    std::size_t number = 0;
    for (const Json& branch : file.at("branches")) {
        for (const Json& point : branch.at("points")) {
            std::string kind = text_at(point, "bifurcation");
            if (kind.empty()) continue;
            std::replace(kind.begin(), kind.end(), '_', ' ');
            const double at = number_at(point, "parameter");
            const double error = number_at(point, "parameter_error");
            const double time = number_at(point, "time");
            table.add({std::to_string(number),
                       kind,
                       {fmt::format("{:.12g}", at), at},
                       number_cell(error, 2),
                       point.at("period").dump(),
                       number_cell(time, 7)});
        }
        ++number;
    }
    return table.html();
}

std::string cascades_table(const Json& cascades) {
    HtmlTable table(
        "Period doublings in a row",
        {{"cascade"}, {"doubling"}, {"parameter"}, {"ratio of distances", true, "tends to Feigenbaum's 4.669"}});
    std::size_t number = 0;
    for (const Json& cascade : cascades) {
        const Json& values = cascade.at("parameter");
        const Json& ratios = cascade.at("ratios");
        for (std::size_t k = 0; k < values.size(); ++k) {
            const double ratio = k >= 2 && k - 2 < ratios.size() && ratios[k - 2].is_number()
                                     ? ratios[k - 2].get<double>()
                                     : std::nan("");
            table.add({std::to_string(number), std::to_string(k + 1), fmt::format("{:.12g}", values[k].get<double>()),
                       number_cell(ratio, 5)});
        }
        ++number;
    }
    return table.html();
}

std::string orbits_table(const Json& list) {
    HtmlTable table("Periodic orbits of the model", {{"orbit"},
                                                     {"period"},
                                                     {"status", false},
                                                     {"largest |multiplier|"},
                                                     {"time [s]"},
                                                     {"residual"},
                                                     {"first point", false}});
    for (std::size_t i = 0; i < std::min(most_orbits, list.size()); ++i) {
        const Json& orbit = list[i];
        double largest = std::nan("");
        if (const Json* multipliers = filled(orbit, "multipliers")) {
            const Json& first = (*multipliers)[0];
            if (first[0].is_number() && first[1].is_number())
                largest = std::hypot(first[0].get<double>(), first[1].get<double>());
        }
        std::string point;
        if (const Json* points = filled(orbit, "points")) {
            for (const Json& value : (*points)[0])
                point += (point.empty() ? "" : ", ") +
                         (value.is_number() ? significant(value.get<double>(), 8) : std::string("undefined"));
        }
        const double time = number_at(orbit, "time");
        const double residual = number_at(orbit, "residual");
        table.add({std::to_string(i), orbit.at("period").dump(), text_at(orbit, "status"), number_cell(largest, 4),
                   number_cell(time, 7), number_cell(residual, 2), point});
    }
    std::string out = table.html();
    if (list.size() > most_orbits)
        out += html_paragraph(fmt::format("The first {} of {} orbits; the others are in the file.", most_orbits,
                                          detail::grouped(list.size())));
    return out;
}

}  // namespace

ReportChapter branch_chapter(const ReportSource& source) {
    ReportChapter chapter{"orbits", "Orbits of the model", ""};
    if (source.run.branch && filled(*source.run.branch, "branches") != nullptr) {
        const Json& file = *source.run.branch;
        std::string html = figure_html(branch_chart(source.run),
                                       "Periodic orbits as the parameter moves: stable ones solid, unstable ones "
                                       "dashed, bifurcations marked.");
        html += html_paragraph(text_at(file, "message"));
        html += bifurcations_table(file);
        if (const Json* cascades = filled(file, "cascades")) html += cascades_table(*cascades);
        chapter.html += html_headed(3, "Branches and bifurcations", html);
    }
    // Orbits of a fit stand beside their cycles in the chapter on the section; these were asked for themselves.
    const Json* orbits = source.run.orbits ? filled(*source.run.orbits, "cycles") : nullptr;
    if (orbits != nullptr) chapter.html += html_headed(3, "Computed orbits", orbits_table(*orbits));
    return chapter;
}

}  // namespace orbid::apps
