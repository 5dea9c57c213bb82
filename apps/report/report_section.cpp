#include <algorithm>
#include <cmath>
#include <map>

#include <fmt/format.h>

#include "apps/documents/json_value.hpp"
#include "apps/report/html_text.hpp"
#include "apps/report/plots/run_charts.hpp"
#include "apps/report/report_chapter.hpp"
#include "apps/report/report_points.hpp"
#include "apps/results/summary_table.hpp"
#include "models/system/stopped.hpp"
#include "orbits/records/data_error.hpp"

namespace orbid::apps {

namespace {

using namespace detail;

/// "-175.8", or "0.2 ± 1.1 i" for one of a pair.
std::string multiplier_text(const Json& pair) {
    const double re = pair.is_array() && pair.size() == 2 ? number_of(pair[0]) : std::nan("");
    const double im = std::isnan(re) ? re : number_of(pair[1]);
    if (!std::isfinite(std::hypot(re, im))) return "undefined";
    if (im == 0.0) return fmt::format("{:.4g}", re);
    return fmt::format("{:.4g} {} {:.4g} i", re, im < 0.0 ? "−" : "+", std::abs(im));
}

std::string multipliers_text(const Json& cycle) {
    std::string out;
    for (const Json& pair : block_at(cycle, "multipliers"))
        append_words(out, multiplier_text(pair), ", ");
    return out;
}

/// Largest sd of a coordinate of a point.
double worst_sd(const Json& cycle) {
    const Json& rows = block_at(cycle, "covariance");
    double worst = std::nan("");
    for (std::size_t i = 0; i < rows.size(); ++i)
        worst = std::fmax(worst, std::sqrt(number_of(rows.at(i).at(i))));
    return worst;
}

/// How each cycle fits: rms of its residuals in standard deviations, by its number.
std::map<std::size_t, double> fit_of_cycles(const std::vector<ResidualRow>& rows) {
    struct Sum {
        double squares = 0.0;
        double count = 0.0;
    };
    constexpr std::string_view prefix = "cycle ";
    std::map<std::size_t, Sum> sums;
    for (const ResidualRow& row : rows) {
        if (!row.block.starts_with(prefix) || !(row.sd > 0.0)) continue;
        const std::string number = row.block.substr(prefix.size());
        if (number.empty() || number.find_first_not_of("0123456789") != std::string::npos) continue;
        const double scaled = (row.observed - row.predicted) / row.sd;
        if (!std::isfinite(scaled)) continue;
        Sum& sum = sums[std::stoul(number)];
        sum.squares += scaled * scaled;
        sum.count += 1.0;
    }
    std::map<std::size_t, double> out;
    for (const auto& [cycle, sum] : sums)
        out[cycle] = std::sqrt(sum.squares / sum.count);
    return out;
}

std::string rotation_text(const Json& cycle) {
    std::string out;
    for (const Json& turns : block_at(cycle, "rotation"))
        append_words(out, turns.dump(), ", ");
    return out;
}

std::string cycles_table(const Json& cycles, const std::vector<ResidualRow>& rows) {
    const auto fits = fit_of_cycles(rows);
    SummaryTable table(
        {"cycle", "period", left_aligned("code"), left_aligned("rotation"),
         explained("largest |multiplier|", "growth of a small distance over one turn"), left_aligned("multipliers"),
         "sd of ln |multiplier|", "worst sd of a point", "time [s]",
         explained("recurrences", "near returns of the record that show the cycle"),
         explained("mirror", "number of the cycle that symmetry makes of this one"),
         explained("fit", "rms of its residuals in standard deviations: near 1; empty when it took no part"),
         left_aligned("remarks")});
    std::size_t number = 0;
    for (const Json& cycle : cycles) {
        const auto fit = fits.find(number);
        std::string remarks;
        for (const Json& remark : block_at(cycle, "quality"))
            append_words(remarks, remark.is_string() ? remark.get<std::string>() : "", ", ");
        table.add({std::to_string(number), std::to_string(whole_number<int>(cycle.at("period"))),
                   text_at(cycle, "code"), rotation_text(cycle), number_cell(largest_multiplier(cycle), 4),
                   multipliers_text(cycle), number_cell(largest_multiplier_sd(cycle), 2),
                   number_cell(worst_sd(cycle), 2), number_cell(number_at(cycle, "time"), 6),
                   number_cell(number_at(cycle, "recurrences"), 6), number_cell(number_at(cycle, "mirror"), 9),
                   fit == fits.end() ? "" : number_cell(fit->second, 3, fit->second > 3.0 ? "caution" : ""), remarks});
        ++number;
    }
    return html_table("Unstable periodic orbits found in the data", table);
}

/// Points of the section that a chart shows.
std::size_t density_points(const Chart& chart) {
    for (const ChartView& view : chart.views) {
        for (const ChartLayer& layer : view.layers)
            if (layer.kind == LayerKind::density) return layer.x.size();
    }
    return 0;
}

}  // namespace

ReportChapter section_chapter(const ReportSource& source) {
    ReportChapter chapter{"section", "Section and periodic orbits", ""};
    const Json& cycles = block_at(source.run.cycles, "cycles");
    Chart chart{"section"};
    std::string words;
    try {
        chart = section_chart(source.run);
        models::stop_if_asked(source.run.interrupted);
        if (!chart.views.empty()) {
            const std::size_t count = density_points(chart);
            words = fmt::format("{} of the section, darker where they are dense{}.", grouped_count(count, "point"),
                                count > most_points ? fmt::format(" (every {}th of them is in this page)",
                                                                  (count + most_points - 1) / most_points)
                                                    : "");
        }
    } catch (const orbits::DataError& error) {
        // The report is about what was found; a record that has gone since is said, not fatal.
        chapter.html += html_paragraph(fmt::format("The record itself cannot be shown: {}", error.what()));
    }
    if (!cycles.empty())
        words += fmt::format("{}Coloured marks are points of {}, by period; the cursor tells which.",
                             words.empty() ? "" : " ", grouped_count(cycles.size(), "periodic orbit"));
    try {
        if (chart.views.empty() && !cycles.empty()) chart = cycle_chart(source.run);
    } catch (const orbits::DataError&) {
        words.clear();  // a model that this program does not know: the tables are there all the same
    }
    chapter.html += figure_html(chart, words);
    if (cycles.empty()) return chapter;
    std::string missing;
    for (const Json& period : block_at(source.run.cycles, "missing"))
        append_words(missing, period.dump(), ", ");
    if (!missing.empty()) chapter.html += html_paragraph(fmt::format("No cycle was found of period {}.", missing));
    chapter.html += figure_html(multiplier_chart(source.run),
                                "How fast neighbours leave each cycle: the largest multiplier in absolute value, by "
                                "period.");
    chapter.html += cycles_table(cycles, source.residuals);
    for (const Json& remark : block_at(source.run.cycles, "remarks"))
        chapter.html += html_paragraph(remark.get<std::string>());
    return chapter;
}

}  // namespace orbid::apps
