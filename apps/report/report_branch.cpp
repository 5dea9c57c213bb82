#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>

#include <fmt/format.h>

#include "apps/drawing/plot_axis.hpp"
#include "apps/report/html_text.hpp"
#include "apps/report/report_chapter.hpp"
#include "apps/results/summary_table.hpp"
#include "apps/stored_run/stored_record.hpp"

namespace orbid::apps {

namespace {

using namespace detail;

constexpr std::size_t most_orbits = 2000;  // rows of the table of computed orbits

/// "plot" of the job's continuation: a coordinate, or "time".
std::string plotted_coordinate(const Json& job) {
    const Json::json_pointer place("/periodic/continuation/plot");
    return job.contains(place) && job.at(place).is_string() ? job.at(place).get<std::string>() : std::string();
}

/// One picture per coordinate of the section; curves are cut where stability changes.
ChartView branch_view(const Json& file, std::size_t coordinate, bool angle) {
    const Json& parameter = file.at("parameter");
    ChartView view;
    ChartRange x;
    ChartRange y;
    std::map<std::string, ChartLayer> marks;
    const std::map<std::string, int> shapes{
        {"period_doubling", 1}, {"fold", 2}, {"branch_point", 4}, {"neimark_sacker", 3}};
    for (const Json& branch : file.at("branches")) {
        const Json& points = branch.at("points");
        std::size_t curves = 0;
        for (const Json& point : points)
            curves = std::max(curves, point.at("points").size());
        for (const bool stable : {true, false}) {
            ChartLayer line{"line", stable ? "stable" : "unstable", stable ? 2 : 1, ""};
            line.dash = !stable;
            for (std::size_t j = 0; j < curves; ++j) {
                double last = std::nan("");
                for (std::size_t k = 0; k < points.size(); ++k) {
                    const bool here = (points[k].at("unstable").get<int>() == 0) == stable;
                    // A change of stability ends one curve and begins the other at the same point.
                    const bool before = k > 0 && (points[k - 1].at("unstable").get<int>() == 0) == stable;
                    const Json& states = points[k].at("points");
                    const double at = number_at(points[k], "parameter");
                    const double read = states[j % states.size()].at(coordinate).get<double>();
                    const double value = angle ? models::wrapped(read) : read;
                    if (angle && std::abs(value - last) > std::numbers::pi) {
                        // It came round the circle: no line across.
                        line.x.push_back(std::nan(""));
                        line.y.push_back(std::nan(""));
                    }
                    last = value;
                    line.x.push_back(at);
                    line.y.push_back(here || before ? value : std::nan(""));
                    x.include(at);
                    y.include(value);
                }
                line.x.push_back(std::nan(""));
                line.y.push_back(std::nan(""));
            }
            view.layers.push_back(std::move(line));
        }
        for (const Json& point : points) {
            const std::string kind = text_at(point, "bifurcation");
            if (kind.empty()) continue;
            ChartLayer& layer = marks[kind];
            layer.kind = "points";
            layer.open = true;
            std::string name = kind;
            std::replace(name.begin(), name.end(), '_', ' ');
            layer.name = name;
            const auto shape = shapes.find(kind);
            layer.style = shape == shapes.end() ? 5 : shape->second;
            for (const Json& state : point.at("points")) {
                layer.x.push_back(number_at(point, "parameter"));
                const double value = state.at(coordinate).get<double>();
                layer.y.push_back(angle ? models::wrapped(value) : value);
                layer.labels.push_back(fmt::format("{}, period {}", name, point.at("period").dump()));
            }
        }
    }
    for (auto& [kind, layer] : marks)
        view.layers.push_back(std::move(layer));
    const auto name = file.at("coordinates")[coordinate].get<std::string>();
    view.label = display_name(name);
    view.x = x.axis(display_name(text_at(parameter, "name")), text_at(parameter, "unit"));
    view.y = y.axis(display_name(name), file.at("units")[coordinate].get<std::string>());
    view.height = 0.6;
    return view;
}

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
                       {significant(error, 2), error},
                       point.at("period").dump(),
                       {significant(time, 7), time}});
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
            table.add({std::to_string(number),
                       std::to_string(k + 1),
                       fmt::format("{:.12g}", values[k].get<double>()),
                       {significant(ratio, 5), ratio}});
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
        table.add({std::to_string(i),
                   orbit.at("period").dump(),
                   text_at(orbit, "status"),
                   {significant(largest, 4), largest},
                   {significant(time, 7), time},
                   {significant(residual, 2), residual},
                   point});
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
        Chart chart{"branch", "Branches of periodic orbits over the parameter", "Coordinate", {}};
        const ModelJob model = stored_model(source.run);
        const std::string plotted = plotted_coordinate(source.run.job);
        for (std::size_t i = 0; i < file.at("coordinates").size(); ++i) {
            const auto name = file.at("coordinates")[i].get<std::string>();
            const bool angle = catalog::coordinate_of(model, name).angle;
            // What the job plots comes first.
            chart.views.insert(name == plotted ? chart.views.begin() : chart.views.end(), branch_view(file, i, angle));
        }
        std::string html = figure_html(source, chart,
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
