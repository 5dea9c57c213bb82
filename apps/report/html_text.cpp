#include "apps/report/html_text.hpp"

#include <cmath>
#include <cstddef>
#include <stdexcept>

#include <fmt/format.h>

#include "apps/drawing/markup_text.hpp"
#include "apps/results/summary_table.hpp"

namespace orbid::apps {

namespace {

/// Fewer rows need no sorting.
constexpr std::size_t sortable_rows = 3;

std::string attributes_of(const HtmlTable::Column& column, const HtmlTable::Cell& cell) {
    std::string classes = column.number ? "n" : "";
    if (!cell.mark.empty()) classes += (classes.empty() ? "" : " ") + cell.mark;
    std::string out = classes.empty() ? "" : fmt::format(" class=\"{}\"", markup_text(classes));
    if (cell.value && std::isfinite(*cell.value)) out += fmt::format(" data-value=\"{}\"", *cell.value);
    return out;
}

}  // namespace

void HtmlTable::add(std::vector<Cell> cells) {
    if (cells.size() != columns_.size())
        throw std::invalid_argument(
            fmt::format("HTML table: {} cells, must be {}, one per column", cells.size(), columns_.size()));
    rows_.push_back(std::move(cells));
}

std::string HtmlTable::html() const {
    if (rows_.empty()) return "";
    std::vector<bool> shown(columns_.size(), false);
    for (const auto& row : rows_) {
        for (std::size_t c = 0; c < row.size(); ++c)
            shown[c] = shown[c] || !row[c].text.empty();
    }
    std::string out = fmt::format(
        "<div class=\"wide\" tabindex=\"0\" role=\"region\" aria-label=\"Table: "
        "{0}\"><table{1}>\n<caption>{0}</caption>\n"
        "<thead><tr>",
        markup_text(caption_), rows_.size() < sortable_rows ? "" : " class=\"sortable\"");
    std::string explanations;
    for (std::size_t c = 0; c < columns_.size(); ++c) {
        const Column& column = columns_[c];
        if (!shown[c]) continue;
        out += fmt::format("<th scope=\"col\"{}>{}</th>", column.number ? " class=\"n\"" : "",
                           markup_text(column.heading));
        if (!column.explanation.empty())
            explanations +=
                fmt::format("<dt>{}</dt><dd>{}</dd>", markup_text(column.heading), markup_text(column.explanation));
    }
    out += "</tr></thead>\n<tbody>\n";
    for (const auto& row : rows_) {
        out += "<tr>";
        bool first = true;
        for (std::size_t c = 0; c < row.size(); ++c) {
            if (!shown[c]) continue;
            const std::string attributes = attributes_of(columns_[c], row[c]);
            out += first ? fmt::format("<th scope=\"row\"{}>{}</th>", attributes, markup_text(row[c].text))
                         : fmt::format("<td{}>{}</td>", attributes, markup_text(row[c].text));
            first = false;
        }
        out += "</tr>\n";
    }
    out += "</tbody></table></div>\n";
    if (!explanations.empty()) out += fmt::format("<dl class=\"key\">{}</dl>\n", explanations);
    return out;
}

HtmlTable::Cell number_cell(double value, int digits, std::string mark) {
    return {significant(value, digits), value, std::move(mark)};
}

HtmlTable::Cell estimate_cell(double value, double sd) {
    return {with_digits_of(value, sd), value};
}

std::string html_paragraph(std::string_view text) {
    return text.empty() ? "" : fmt::format("<p>{}</p>\n", markup_text(text));
}

std::string html_headed(int level, std::string_view heading, const std::string& html) {
    return html.empty() ? "" : fmt::format("<h{0}>{1}</h{0}>\n{2}", level, markup_text(heading), html);
}

}  // namespace orbid::apps
