#include <algorithm>
#include <cmath>
#include <map>

#include <fmt/format.h>

#include "apps/report/html_text.hpp"
#include "apps/report/plots/run_charts.hpp"
#include "apps/report/report_chapter.hpp"
#include "apps/report/report_points.hpp"
#include "apps/results/summary_table.hpp"
#include "orbits/records/data_error.hpp"

namespace orbid::apps {

namespace {

using namespace detail;

double modulus(const Json& pair) {
    if (!pair.is_array() || pair.size() != 2 || !pair[0].is_number() || !pair[1].is_number()) return std::nan("");
    return std::hypot(pair[0].get<double>(), pair[1].get<double>());
}

/// "-175.8", or "0.2 ± 1.1 i" for one of a pair.
std::string multiplier_text(const Json& pair) {
    if (!std::isfinite(modulus(pair))) return "undefined";
    const double re = pair[0].get<double>();
    const double im = pair[1].get<double>();
    if (im == 0.0) return fmt::format("{:.4g}", re);
    return fmt::format("{:.4g} {} {:.4g} i", re, im < 0.0 ? "−" : "+", std::abs(im));
}

std::string multipliers_text(const Json& cycle) {
    const Json* list = filled(cycle, "multipliers");
    std::string out;
    if (list == nullptr) return out;
    for (const Json& pair : *list)
        out += (out.empty() ? "" : ", ") + multiplier_text(pair);
    return out;
}

/// Largest sd of a coordinate of a point.
double worst_sd(const Json& cycle) {
    const Json* rows = filled(cycle, "covariance");
    double worst = std::nan("");
    if (rows == nullptr) return worst;
    for (std::size_t i = 0; i < rows->size(); ++i) {
        const Json& variance = (*rows)[i][i];
        if (variance.is_number()) worst = std::fmax(worst, std::sqrt(variance.get<double>()));
    }
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
    const Json* list = filled(cycle, "rotation");
    std::string out;
    if (list == nullptr) return out;
    for (const Json& turns : *list)
        out += (out.empty() ? "" : ", ") + turns.dump();
    return out;
}

std::string cycles_table(const Json& cycles, const std::vector<ResidualRow>& rows) {
    const auto fits = fit_of_cycles(rows);
    HtmlTable table("Unstable periodic orbits found in the data",
                    {{"cycle"},
                     {"period"},
                     {"code", false},
                     {"rotation", false},
                     {"largest |multiplier|", true, "growth of a small distance over one turn"},
                     {"multipliers", false},
                     {"sd of ln |multiplier|"},
                     {"worst sd of a point"},
                     {"time [s]"},
                     {"recurrences", true, "near returns of the record that show the cycle"},
                     {"mirror", true, "number of the cycle that symmetry makes of this one"},
                     {"fit", true, "rms of its residuals in standard deviations: near 1; empty when it took no part"},
                     {"remarks", false}});
    std::size_t number = 0;
    for (const Json& cycle : cycles) {
        const double largest = largest_multiplier(cycle);
        const double worst = worst_sd(cycle);
        const double sd = largest_multiplier_sd(cycle);
        const auto fit = fits.find(number);
        const double time = number_at(cycle, "time");
        const double recurrences = number_at(cycle, "recurrences");
        const double mirror = number_at(cycle, "mirror");
        std::string remarks;
        if (const Json* quality = filled(cycle, "quality")) {
            for (const Json& remark : *quality)
                remarks += (remarks.empty() ? "" : ", ") + (remark.is_string() ? remark.get<std::string>() : "");
        }
        table.add(
            {std::to_string(number), std::to_string(cycle.at("period").get<int>()), text_at(cycle, "code"),
             rotation_text(cycle), number_cell(largest, 4), multipliers_text(cycle), number_cell(sd, 2),
             number_cell(worst, 2), number_cell(time, 6), number_cell(recurrences, 6), number_cell(mirror, 9),
             fit == fits.end() ? HtmlTable::Cell("") : number_cell(fit->second, 3, fit->second > 3.0 ? "caution" : ""),
             remarks});
        ++number;
    }
    return table.html();
}

/// Points of the section that a chart shows.
std::size_t density_points(const Chart& chart) {
    for (const ChartView& view : chart.views) {
        for (const ChartLayer& layer : view.layers)
            if (layer.kind == "density") return layer.x.size();
    }
    return 0;
}

}  // namespace

ReportChapter section_chapter(const ReportSource& source) {
    ReportChapter chapter{"section", "Section and periodic orbits", ""};
    const Json* cycles = source.run.cycles ? filled(*source.run.cycles, "cycles") : nullptr;
    Chart chart{"section"};
    std::string words;
    try {
        chart = section_chart(source.run);
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
    if (cycles != nullptr)
        words += fmt::format("{}Coloured marks are points of {}, by period; the cursor tells which.",
                             words.empty() ? "" : " ", grouped_count(cycles->size(), "periodic orbit"));
    try {
        if (chart.views.empty() && cycles != nullptr) chart = cycle_chart(source.run);
    } catch (const orbits::DataError&) {
        words.clear();  // a model that this program does not know: the tables are there all the same
    }
    chapter.html += figure_html(chart, words);
    if (cycles == nullptr) return chapter;
    if (const Json* missing = filled(*source.run.cycles, "missing")) {
        std::string list;
        for (const Json& period : *missing)
            list += (list.empty() ? "" : ", ") + period.dump();
        chapter.html += html_paragraph(fmt::format("No cycle was found of period {}.", list));
    }
    chapter.html += figure_html(multiplier_chart(source.run),
                                "How fast neighbours leave each cycle: the largest multiplier in absolute value, by "
                                "period.");
    chapter.html += cycles_table(*cycles, source.residuals);
    if (const Json* remarks = filled(*source.run.cycles, "remarks")) {
        for (const Json& remark : *remarks)
            chapter.html += html_paragraph(remark.get<std::string>());
    }
    return chapter;
}

}  // namespace orbid::apps
