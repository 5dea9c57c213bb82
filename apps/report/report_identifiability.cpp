#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "apps/drawing/markup_text.hpp"
#include "apps/report/html_text.hpp"
#include "apps/report/plots/run_charts.hpp"
#include "apps/report/report_chapter.hpp"
#include "apps/results/summary_table.hpp"

namespace orbid::apps {

namespace {

using namespace detail;

/// More parameters than this make a table that nobody reads; the strongest pairs are listed instead.
constexpr std::size_t readable = 24;

/// Shade of a cell: five steps of |correlation| in both signs; the number beside it says the same.
std::string shade(double value) {
    const double size = std::abs(value);
    const int step = size < 0.2 ? 0 : size < 0.5 ? 1 : size < 0.8 ? 2 : size < 0.95 ? 3 : 4;
    return step == 0 ? "" : fmt::format("{}{}", value > 0.0 ? "p" : "m", step);
}

std::string correlation_table(const Json& names, const Json& matrix) {
    std::vector<SummaryTable::Column> columns{left_aligned("estimate")};
    for (const Json& name : names)
        columns.push_back({name.get<std::string>()});
    SummaryTable table(std::move(columns));
    for (std::size_t i = 0; i < names.size(); ++i) {
        SummaryTable::Row cells{names.at(i).get<std::string>()};
        for (std::size_t j = 0; j < names.size(); ++j) {
            if (!matrix.at(i).at(j).is_number())
                cells.emplace_back("undefined");
            else if (i == j)
                cells.emplace_back("1", 1.0);
            else {
                const double value = matrix.at(i).at(j).get<double>();
                cells.emplace_back(fmt::format("{:+.2f}", value), value, shade(value));
            }
        }
        table.add(std::move(cells));
    }
    return html_table("Correlations of the estimates", table);
}

std::string strongest_table(const Json& names, const Json& matrix) {
    struct Pair {
        std::size_t i, j;
        double value;
    };
    std::vector<Pair> pairs;
    for (std::size_t i = 0; i < names.size(); ++i) {
        for (std::size_t j = 0; j < i; ++j)
            if (matrix.at(i).at(j).is_number()) pairs.push_back({j, i, matrix.at(i).at(j).get<double>()});
    }
    std::stable_sort(pairs.begin(), pairs.end(),
                     [](const Pair& a, const Pair& b) { return std::abs(a.value) > std::abs(b.value); });
    SummaryTable table({left_aligned("first"), left_aligned("second"), "correlation"});
    for (std::size_t k = 0; k < std::min(readable, pairs.size()); ++k)
        table.add({names.at(pairs[k].i).get<std::string>(),
                   names.at(pairs[k].j).get<std::string>(),
                   {fmt::format("{:+.3f}", pairs[k].value), pairs[k].value, shade(pairs[k].value)}});
    return html_table("Strongest correlations of the estimates", table);
}

std::string correlations(const Json& result) {
    const Json& names = block_at(block_at(result, "correlation"), "names");
    const Json& matrix = block_at(block_at(result, "correlation"), "matrix");
    if (names.size() < 2 || matrix.size() != names.size()) return "";
    return html_paragraph(
               "Two estimates with a correlation near 1 or −1 are known as a combination far better than each for "
               "itself.") +
           (names.size() <= readable ? correlation_table(names, matrix) : strongest_table(names, matrix));
}

std::string null_directions(const Json& directions, const Json& told) {
    std::string out = "<ul>\n";
    for (std::size_t i = 0; i < directions.size(); ++i) {
        const Json& direction = directions.at(i);
        std::string names;
        std::string sizes;
        for (const auto& [name, component] : direction.items()) {
            append_words(names, name, ", ");
            append_words(sizes, fmt::format("{:+.3g}", component.get<double>()), " : ");
        }
        const std::string words =
            direction.size() == 1
                ? fmt::format("{} has no effect on the data.", names)
                : fmt::format(
                      "{} cannot be told apart: changing them together by {} (relative) leaves every residual "
                      "as it is. Hold one of them, or give it a prior.",
                      names, sizes);
        const bool known = i < told.size() && told[i].is_string();
        out += fmt::format("<li>{}{}</li>\n", markup_text(words),
                           known ? " Told: " + markup_text(told[i].get<std::string>()) + "." : "");
    }
    return out + "</ul>\n";
}

std::string sloppy_directions(const Json& directions) {
    std::string out = "<ul>\n";
    for (const Json& direction : directions) {
        std::string names;
        for (const auto& [name, component] : block_at(direction, "exponents").items())
            append_words(names, name, ", ");
        const std::string told = text_at(direction, "told");
        out += fmt::format("<li>{}</li>\n",
                           markup_text(fmt::format("{}: the sd of the logarithm along their direction is {:.3g}.{}",
                                                   names, number_at(direction, "sd_of_logarithm"),
                                                   told.empty() ? "" : " Told: " + told + ".")));
    }
    return out + "</ul>\n";
}

/// What no record of these readings determines, found before the fit.
std::string structural_directions(const Json& structural) {
    std::string out = "<ul>\n";
    for (const Json& direction : block_at(structural, "directions"))
        out += fmt::format("<li>{}</li>\n",
                           markup_text(fmt::format("{}. Held at its start: {}.", text_at(direction, "text"),
                                                   text_at(direction, "held"))));
    for (const Json& signs : block_at(structural, "signs")) {
        std::string names;
        for (const Json& name : signs)
            append_words(names, name.get<std::string>(), ", ");
        out += fmt::format("<li>{}</li>\n", markup_text(fmt::format("The sign of {} is a matter of choice.", names)));
    }
    return out + "</ul>\n";
}

}  // namespace

ReportChapter identifiability_chapter(const ReportSource& source) {
    ReportChapter chapter{"identifiability", "What the data determine", ""};
    if (!source.run.result) return chapter;
    const Json& result = *source.run.result;
    const Json& identifiability = block_at(result, "identifiability");
    if (identifiability.empty() || block_at(result, "parameters").empty()) return chapter;
    const Json& structural = block_at(identifiability, "structural");
    if (!block_at(structural, "directions").empty() || !block_at(structural, "signs").empty())
        chapter.html += html_headed(3, "Determined by no record", structural_directions(structural));
    if (const Json& directions = block_at(identifiability, "null_directions"); !directions.empty())
        chapter.html +=
            html_headed(3, "Not determined", null_directions(directions, block_at(identifiability, "told")));
    if (const Json& directions = block_at(identifiability, "sloppy_directions"); !directions.empty())
        chapter.html += html_headed(3, "Hardly determined", sloppy_directions(directions));
    chapter.html += html_headed(3, "Correlations", correlations(result));
    chapter.html += html_headed(
        3, "Stiff and sloppy directions",
        figure_html(singular_value_chart(source.run),
                    "How strongly the residuals answer to relative changes of the parameters, by direction. "
                    "Those far to the lower right are sloppy: the data say little about them; a value of zero is a "
                    "direction that they do not determine at all."));
    return chapter;
}

}  // namespace orbid::apps
