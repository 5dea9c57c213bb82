#include <cmath>

#include <fmt/format.h>

#include "apps/report/html_text.hpp"
#include "apps/report/plots/run_charts.hpp"
#include "apps/report/report_chapter.hpp"
#include "apps/results/summary_table.hpp"

namespace orbid::apps {

namespace {

using namespace detail;

std::string parameter_interval_text(const Json& entry, double sd) {
    const double lower = interval_end(entry, 0);
    const double upper = interval_end(entry, 1);
    if (!std::isfinite(lower) || !std::isfinite(upper)) return "undefined";
    return fmt::format("[{}, {}]", with_digits_of(lower, sd), with_digits_of(upper, sd));
}

double in_sds(const Json& entry) {
    const double sd = number_at(entry, "sd");
    return sd > 0.0 ? (number_at(entry, "value") - number_at(entry, "reference")) / sd
                    : std::numeric_limits<double>::quiet_NaN();
}

std::string estimated_table(const std::string& caption, const Json& list) {
    HtmlTable table(caption, {{"name", false},
                              {"value"},
                              {"± sd"},
                              {"unit", false},
                              {"95 % interval", false},
                              {"method", false, "how the interval was made"},
                              {"start"},
                              {"reference"},
                              {"deviation", true, "of the value from the reference"},
                              {"in sds", true, "the same in standard deviations: mostly within 2"},
                              {"data share", true, "of the information; the rest is the prior's"},
                              {"bound", false}});
    for (const auto& [name, entry] : list.items()) {
        const double value = number_at(entry, "value");
        const double sd = number_at(entry, "sd");
        const double deviates = in_sds(entry);
        const double share = number_at(entry, "data_share");
        const std::string bound = text_at(entry, "at_bound");
        table.add({name,
                   estimate_cell(value, sd),
                   {std::isfinite(sd) ? significant(sd, 2) : "undefined", sd},
                   text_at(entry, "unit"),
                   parameter_interval_text(entry, sd),
                   text_at(entry, "interval_method"),
                   number_cell(number_at(entry, "start"), 4),
                   number_cell(number_at(entry, "reference"), 8),
                   {percent(number_at(entry, "relative_deviation")), number_at(entry, "relative_deviation")},
                   {std::isfinite(deviates) ? fmt::format("{:+.2f}", deviates) : "", deviates,
                    std::abs(deviates) > 3.0 ? "caution" : ""},
                   // A full share is the usual case and says nothing.
                   {share < 0.9995 ? fmt::format("{:.3g} %", 100.0 * share) : "", share},
                   {bound.empty() ? "" : "at " + bound, 0.0, "caution"}});
    }
    return table.html();
}

std::string errors_table(const Json& errors) {
    HtmlTable table(
        "Errors, as estimated with the parameters",
        {{"group", false},
         {"records"},
         {"rms"},
         {"unit", false},
         {"errors", false},
         {"sd"},
         {"factor", true, "on the standard deviations that the analysis or the data gave; 1 when they hold"},
         {"±"},
         {"lag-1", true, "correlation of neighbouring residuals: near 0 when errors are independent"},
         {"worth about", true, "independent records"}});
    for (const auto& [group, entry] : errors.items()) {
        const double factor = number_at(entry, "factor");
        const bool is_factor = std::isfinite(factor);
        const bool estimated = entry.value("estimated", true);
        const double lag = number_at(entry, "lag1");
        const double count = number_at(entry, "count");
        const double worth = number_at(entry, "effective_count");
        table.add(
            {group,
             {fmt::format("{:.0f}", count), count},
             number_cell(number_at(entry, "rms"), 4),
             text_at(entry, "unit"),
             text_at(entry, "distribution"),
             is_factor ? HtmlTable::Cell("") : number_cell(number_at(entry, "sd"), 4),
             number_cell(factor, 4),
             estimated ? number_cell(number_at(entry, "uncertainty"), 2) : HtmlTable::Cell("fixed"),
             {std::isfinite(lag) ? fmt::format("{:.3f}", lag) : "", lag},
             {std::isfinite(lag) ? fmt::format("{:.0f}", worth) : "", worth, worth < 0.5 * count ? "caution" : ""}});
    }
    return table.html();
}

std::string states_table(const std::string& caption, const Json& states, const char* member) {
    HtmlTable table(caption, {{"experiment", false},
                              {"segment", false},
                              {"coordinate", false},
                              {"value"},
                              {"± sd"},
                              {"unit", false},
                              {"treatment", false}});
    for (const Json& state : states) {
        const auto add = [&](const std::string& name, const Json& value) {
            const double sd = number_at(value, "sd");
            table.add({text_at(state, "experiment"), text_at(state, "segment"), name,
                       estimate_cell(number_at(value, "value"), sd), number_cell(sd, 2), text_at(value, "unit"),
                       value.value("estimated", true) ? "" : "held"});
        };
        if (const Json* phase = filled(state, "phase")) add("phase", *phase);
        if (const Json* values = filled(state, member)) {
            for (const auto& [name, value] : values->items())
                add(name, value);
        }
    }
    return table.html();
}

std::string covariances_table(const Json& covariances) {
    HtmlTable table("Covariances of errors", {{"groups", false}, {"covariance"}, {"±"}, {"correlation"}});
    for (const Json& covariance : covariances) {
        const Json& groups = covariance.at("groups");
        const Json& v = covariance.at("matrix");
        for (std::size_t j = 0; j < groups.size(); ++j) {
            for (std::size_t i = j; i < groups.size(); ++i) {
                const double value = v[i][j].is_number() ? v[i][j].get<double>() : std::nan("");
                const auto row = groups[i].get<std::string>();
                const std::string name = i == j ? row : groups[j].get<std::string>() + ", " + row;
                const Json& uncertainty = covariance.at("uncertainty")[i][j];
                const double correlation =
                    i == j ? std::nan("") : value / std::sqrt(v[i][i].get<double>() * v[j][j].get<double>());
                table.add({name,
                           number_cell(value, 5),
                           number_cell(uncertainty.is_number() ? uncertainty.get<double>() : std::nan(""), 2),
                           {std::isfinite(correlation) ? fmt::format("{:+.3f}", correlation) : "", correlation}});
            }
        }
    }
    return table.html();
}

}  // namespace

ReportChapter parameter_chapter(const ReportSource& source) {
    ReportChapter chapter{"parameters", "Parameters", ""};
    if (!source.run.result) return chapter;
    const Json& result = *source.run.result;
    if (const Json* list = filled(result, "parameters")) chapter.html += estimated_table("Parameters", *list);
    if (const Json* list = filled(result, "derived")) chapter.html += estimated_table("Derived quantities", *list);
    chapter.html += figure_html(parameter_chart(source.run),
                                "Estimates with their 95 % intervals, seen from the reference values. Intervals should "
                                "reach the line at 0 in 19 of 20 cases.");
    if (const Json* list = filled(result, "errors")) chapter.html += html_headed(3, "Errors", errors_table(*list));
    if (const Json* list = filled(result, "covariances")) chapter.html += covariances_table(*list);
    if (const Json* list = filled(result, "initial_states"))
        chapter.html += html_headed(3, "Initial states", states_table("Initial states of segments", *list, "state"));
    if (const Json* list = filled(result, "steady_states"))
        chapter.html += html_headed(3, "Steady states",
                                    states_table("Phase and offsets of measured steady states", *list, "offset"));
    return chapter;
}

}  // namespace orbid::apps
