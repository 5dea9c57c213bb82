#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <set>

#include <fmt/format.h>

#include "apps/drawing/plot_axis.hpp"
#include "apps/report/html_text.hpp"
#include "apps/report/report_chapter.hpp"
#include "apps/results/summary_table.hpp"
#include "apps/stored_run/stored_section.hpp"
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

double largest_multiplier(const Json& cycle) {
    const Json* list = filled(cycle, "multipliers");
    return list == nullptr ? std::nan("") : modulus((*list)[0]);
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
        const Json* variances = filled(cycle, "ln_multiplier_covariance");
        const double sd = variances != nullptr && (*variances)[0][0].is_number()
                              ? std::sqrt((*variances)[0][0].get<double>())
                              : std::nan("");
        const auto fit = fits.find(number);
        const double time = number_at(cycle, "time");
        const double recurrences = number_at(cycle, "recurrences");
        const double mirror = number_at(cycle, "mirror");
        std::string remarks;
        if (const Json* quality = filled(cycle, "quality")) {
            for (const Json& remark : *quality)
                remarks += (remarks.empty() ? "" : ", ") + (remark.is_string() ? remark.get<std::string>() : "");
        }
        table.add({std::to_string(number),
                   std::to_string(cycle.at("period").get<int>()),
                   text_at(cycle, "code"),
                   rotation_text(cycle),
                   {significant(largest, 4), largest},
                   multipliers_text(cycle),
                   {significant(sd, 2), sd},
                   {significant(worst, 2), worst},
                   {significant(time, 6), time},
                   {significant(recurrences, 6), recurrences},
                   {significant(mirror, 9), mirror},
                   fit == fits.end()
                       ? HtmlTable::Cell("")
                       : HtmlTable::Cell(significant(fit->second, 3), fit->second, fit->second > 3.0 ? "caution" : ""),
                   remarks});
        ++number;
    }
    return table.html();
}

/// Points of cycles by period, in the first two coordinates.
std::vector<ChartLayer> cycle_layers(const Json& cycles, bool first_is_angle, bool second_is_angle) {
    std::map<int, ChartLayer> periods;
    const auto on_axis = [](double value, bool angle) { return angle ? models::wrapped(value) : value; };
    std::size_t number = 0;
    for (const Json& cycle : cycles) {
        const int period = cycle.at("period").get<int>();
        ChartLayer& layer = periods[period];
        layer.kind = "points";
        layer.name = fmt::format("period {}", period);
        layer.style = std::clamp(period, 1, 8);
        const Json& points = cycle.at("points");
        for (std::size_t j = 0; j < points.size(); ++j) {
            layer.x.push_back(on_axis(points[j].at(0).get<double>(), first_is_angle));
            layer.y.push_back(on_axis(points[j].at(1).get<double>(), second_is_angle));
            layer.labels.push_back(fmt::format("cycle {}, point {} of {}, largest |multiplier| {:.4g}", number, j + 1,
                                               points.size(), largest_multiplier(cycle)));
        }
        ++number;
    }
    // Long periods first, so that the few short ones stay on top.
    std::vector<ChartLayer> layers;
    for (auto entry = periods.rbegin(); entry != periods.rend(); ++entry)
        layers.push_back(std::move(entry->second));
    return layers;
}

ChartAxis whole_axis(const orbits::SeriesCoordinate& coordinate, const ChartRange& range) {
    ChartAxis axis = range.axis(display_name(coordinate.name), coordinate.unit);
    if (coordinate.angle) {
        axis.lower = -std::numbers::pi;
        axis.upper = std::numbers::pi;
        axis.circle = true;
    }
    return axis;
}

/// The section under its periodic points; `blocks` takes its points.
Chart section_chart(const SectionPoints& section, const Json* cycles, PointBlocks& blocks) {
    const auto& [first, second] = section.coordinates;
    ChartView view;
    if (cycles != nullptr) view.layers = cycle_layers(*cycles, first.angle, second.angle);
    ChartRange x;
    ChartRange y;
    x.include(section.x);
    y.include(section.y);
    for (const ChartLayer& layer : view.layers) {
        x.include(layer.x);
        y.include(layer.y);
    }
    view.x = whole_axis(first, x);
    view.y = whole_axis(second, y);
    view.height = 0.66;
    view.layers.insert(view.layers.begin(), ChartLayer{"density", "section", 1, "cloud"});
    const auto share = [](const ChartAxis& axis, double value, bool angle) {
        return ((angle ? models::wrapped(value) : value) - axis.lower) / (axis.upper - axis.lower);
    };
    std::vector<std::pair<double, double>> points;
    points.reserve(section.x.size());
    for (std::size_t i = 0; i < section.x.size(); ++i)
        points.emplace_back(share(view.x, section.x[i], first.angle), share(view.y, section.y[i], second.angle));
    blocks = point_blocks(points);
    Chart chart{"section", "The section of the record and its periodic points by period", "", {}};
    chart.views.push_back(std::move(view));
    return chart;
}

/// Largest multipliers by period, those of one period side by side by size, to see how unstable the skeleton is.
Chart multiplier_chart(const Json& cycles) {
    std::map<int, std::vector<std::pair<double, std::size_t>>> periods;
    ChartRange range;
    for (std::size_t number = 0; number < cycles.size(); ++number) {
        const double largest = largest_multiplier(cycles[number]);
        if (!(largest > 0.0)) continue;
        periods[cycles[number].at("period").get<int>()].emplace_back(largest, number);
        range.include(largest);
    }
    Chart chart{"multipliers", "Largest multiplier of each cycle by period", "", {}};
    if (range.empty()) return chart;
    ChartView view;
    for (auto& [period, list] : periods) {
        std::sort(list.begin(), list.end());
        ChartLayer layer{"points", fmt::format("period {}", period), std::clamp(period, 1, 8), ""};
        for (std::size_t k = 0; k < list.size(); ++k) {
            // Within 0.8 of the way to the next period.
            layer.x.push_back(period + 0.8 * ((static_cast<double>(k) + 0.5) / static_cast<double>(list.size()) - 0.5));
            layer.y.push_back(list[k].first);
            layer.labels.push_back(fmt::format("cycle {}", list[k].second));
        }
        view.layers.push_back(std::move(layer));
    }
    view.x = {"period, cycles by size", "", periods.begin()->first - 0.6, periods.rbegin()->first + 0.6};
    view.x.whole = true;
    view.y = range.axis("largest |multiplier|", "", true);
    view.height = 0.45;
    chart.views.push_back(std::move(view));
    return chart;
}

}  // namespace

ReportChapter section_chapter(const ReportSource& source) {
    ReportChapter chapter{"section", "Section and periodic orbits", ""};
    const Json* cycles = source.run.cycles ? filled(*source.run.cycles, "cycles") : nullptr;
    Chart chart{"section", "", "", {}};
    PointBlocks blocks;
    std::string words;
    try {
        if (const auto section = section_points(source.run)) {
            chart = section_chart(*section, cycles, blocks);
            words =
                fmt::format("{} of the section, darker where they are dense{}.", grouped_count(blocks.given, "point"),
                            blocks.kept < blocks.given ? fmt::format(" (every {}th of them is in this page)",
                                                                     (blocks.given + blocks.kept - 1) / blocks.kept)
                                                       : "");
        }
    } catch (const orbits::DataError& error) {
        // The report is about what was found; a record that has gone since is said, not fatal.
        chapter.html += html_paragraph(fmt::format("The record itself cannot be shown: {}", error.what()));
    }
    if (cycles != nullptr)
        words += fmt::format("{}Coloured marks are points of {}, by period; the cursor tells which.",
                             words.empty() ? "" : " ", grouped_count(cycles->size(), "periodic orbit"));
    chapter.html += figure_html(source, chart, words, &blocks);
    if (cycles == nullptr) return chapter;
    if (chart.views.empty() && source.still_plots.count("section") == 0) {
        Chart alone{"cycles", "", "", {}};
        chapter.html += figure_html(source, alone, words);
    }
    if (const Json* missing = filled(*source.run.cycles, "missing")) {
        std::string list;
        for (const Json& period : *missing)
            list += (list.empty() ? "" : ", ") + period.dump();
        chapter.html += html_paragraph(fmt::format("No cycle was found of period {}.", list));
    }
    chapter.html += figure_html(source, multiplier_chart(*cycles),
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
