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
    const std::string limit = text_at(entry, "one_sided");
    const double digits = std::isfinite(sd) ? sd : 0.1 * (upper - lower);
    return fmt::format("[{}, {}]{}", with_digits_of(lower, digits), with_digits_of(upper, digits),
                       limit.empty() ? "" : " " + limit + " limit");
}

double in_sds(const Json& entry) {
    const double sd = number_at(entry, "sd");
    return sd > 0.0 ? (number_at(entry, "value") - number_at(entry, "reference")) / sd
                    : std::numeric_limits<double>::quiet_NaN();
}

std::string estimated_table(const std::string& caption, const Json& list) {
    SummaryTable table({left_aligned("name"), "value", "± sd", left_aligned("unit"), left_aligned("95 % interval"),
                        explained(left_aligned("method"), "how the interval was made"), "start", "reference",
                        explained("deviation", "of the value from the reference"),
                        explained("in sds", "the same in standard deviations: mostly within 2"),
                        explained("data share", "of the information; the rest is the prior's"), left_aligned("bound")});
    for (const auto& [name, entry] : list.items()) {
        const double sd = number_at(entry, "sd");
        const double deviates = in_sds(entry);
        const double share = number_at(entry, "data_share");
        const std::string bound = text_at(entry, "at_bound");
        table.add({name,
                   estimate_cell(number_at(entry, "value"), sd),
                   {std::isfinite(sd)        ? significant(sd, 2)
                    : entry.contains("held") ? "held"
                                             : "undefined",
                    sd},
                   text_at(entry, "unit"),
                   parameter_interval_text(entry, sd),
                   text_at(entry, "interval_method"),
                   number_cell(number_at(entry, "start"), 4),
                   number_cell(number_at(entry, "reference"), 8),
                   {percent(number_at(entry, "relative_deviation")), number_at(entry, "relative_deviation")},
                   formatted_cell("{:+.2f}", deviates, std::abs(deviates) > 3.0 ? "caution" : ""),
                   // A full share is the usual case and says nothing.
                   {share < 0.9995 ? fmt::format("{:.3g} %", 100.0 * share) : "", share},
                   {bound.empty() ? "" : "at " + bound, 0.0, "caution"}});
    }
    return html_table(caption, table);
}

std::string errors_table(const Json& errors) {
    SummaryTable table(
        {left_aligned("group"), "records", "rms", left_aligned("unit"), left_aligned("errors"), "sd",
         explained("factor", "on the standard deviations that the analysis or the data gave; 1 when they hold"), "±",
         explained("lag-1", "correlation of neighbouring residuals: near 0 when errors are independent"),
         explained("worth about", "independent records")});
    for (const auto& [group, entry] : errors.items()) {
        const double factor = number_at(entry, "factor");
        const bool is_factor = std::isfinite(factor);
        const bool estimated = entry.value("estimated", true);
        const double lag = number_at(entry, "lag1");
        const double count = number_at(entry, "count");
        const double worth = number_at(entry, "effective_count");
        table.add(
            {group,
             formatted_cell("{:.0f}", count),
             number_cell(number_at(entry, "rms"), 4),
             text_at(entry, "unit"),
             text_at(entry, "distribution"),
             is_factor ? "" : number_cell(number_at(entry, "sd"), 4),
             number_cell(factor, 4),
             estimated ? number_cell(number_at(entry, "uncertainty"), 2) : "fixed",
             formatted_cell("{:.3f}", lag),
             {std::isfinite(lag) ? fmt::format("{:.0f}", worth) : "", worth, worth < 0.5 * count ? "caution" : ""}});
    }
    return html_table("Errors, as estimated with the parameters", table);
}

std::string states_table(const std::string& caption, const Json& states, const char* member) {
    SummaryTable table({left_aligned("experiment"), left_aligned("segment"), left_aligned("coordinate"), "value",
                        "± sd", left_aligned("unit"), left_aligned("treatment")});
    for (const Json& state : states) {
        const auto add = [&](const std::string& name, const Json& value) {
            const double sd = number_at(value, "sd");
            table.add({text_at(state, "experiment"), text_at(state, "segment"), name,
                       estimate_cell(number_at(value, "value"), sd), number_cell(sd, 2), text_at(value, "unit"),
                       value.value("estimated", true) ? "" : "held"});
        };
        if (const Json& phase = block_at(state, "phase"); !phase.empty()) add("phase", phase);
        for (const auto& [name, value] : block_at(state, member).items())
            add(name, value);
    }
    return html_table(caption, table);
}

std::string covariances_table(const Json& covariances) {
    SummaryTable table({left_aligned("groups"), "covariance", "±", "correlation"});
    for (const Json& covariance : covariances) {
        const Json& groups = covariance.at("groups");
        const Json& v = covariance.at("matrix");
        for (std::size_t j = 0; j < groups.size(); ++j) {
            for (std::size_t i = j; i < groups.size(); ++i) {
                const double value = number_of(v.at(i).at(j));
                const auto row = groups.at(i).get<std::string>();
                const std::string name = i == j ? row : groups.at(j).get<std::string>() + ", " + row;
                const double correlation =
                    i == j ? std::nan("")
                           : value / std::sqrt(v.at(i).at(i).get<double>() * v.at(j).at(j).get<double>());
                table.add({name, number_cell(value, 5),
                           number_cell(number_of(covariance.at("uncertainty").at(i).at(j)), 2),
                           formatted_cell("{:+.3f}", correlation)});
            }
        }
    }
    return html_table("Covariances of errors", table);
}

}  // namespace

ReportChapter parameter_chapter(const ReportSource& source) {
    ReportChapter chapter{"parameters", "Parameters", ""};
    if (!source.run.result) return chapter;
    const Json& result = *source.run.result;
    chapter.html += estimated_table("Parameters", block_at(result, "parameters"));
    chapter.html += estimated_table("Derived quantities", block_at(result, "derived"));
    chapter.html += figure_html(
        parameter_chart(source.run),
        has_references(source.run)
            ? "Estimates with their 95 % intervals, seen from the reference values. Intervals should reach the line at "
              "0 in 19 of 20 cases."
            : "95 % intervals, in percent of the estimates.");
    chapter.html += html_headed(3, "Errors", errors_table(block_at(result, "errors")));
    chapter.html += covariances_table(block_at(result, "covariances"));
    chapter.html += html_headed(
        3, "Initial states", states_table("Initial states of segments", block_at(result, "initial_states"), "state"));
    chapter.html += html_headed(
        3, "Steady states",
        states_table("Phase and offsets of measured steady states", block_at(result, "steady_states"), "offset"));
    return chapter;
}

}  // namespace orbid::apps
