#include "apps/report/html_text.hpp"

#include <cmath>
#include <cstddef>
#include <vector>

#include <fmt/format.h>

#include "apps/drawing/markup_text.hpp"

namespace orbid::apps {

namespace {

/// Fewer rows need no sorting.
constexpr std::size_t sortable_rows = 3;

std::string attributes_of(const SummaryTable::Column& column, const SummaryTable::Cell& cell) {
    std::string classes = column.align == SummaryTable::Align::right ? "n" : "";
    if (!cell.mark.empty()) classes += (classes.empty() ? "" : " ") + cell.mark;
    std::string out = classes.empty() ? "" : fmt::format(" class=\"{}\"", markup_text(classes));
    if (cell.value && std::isfinite(*cell.value)) out += fmt::format(" data-value=\"{}\"", *cell.value);
    return out;
}

}  // namespace

std::string html_table(std::string_view caption, const SummaryTable& table) {
    if (table.empty()) return "";
    std::string out = fmt::format(
        "<div class=\"wide\" tabindex=\"0\" role=\"region\" aria-label=\"Table: "
        "{0}\"><table{1}>\n<caption>{0}</caption>\n"
        "<thead><tr>",
        markup_text(caption), table.rows().size() < sortable_rows ? "" : " class=\"sortable\"");
    std::string explanations;
    std::vector<std::size_t> shown;
    for (std::size_t c = 0; c < table.columns().size(); ++c) {
        if (!table.shows(c)) continue;
        shown.push_back(c);
        const SummaryTable::Column& column = table.columns()[c];
        const std::string heading = markup_text(column.heading);
        out += fmt::format("<th scope=\"col\"{}>{}</th>", attributes_of(column, ""), heading);
        if (!column.explanation.empty())
            explanations += fmt::format("<dt>{}</dt><dd>{}</dd>", heading, markup_text(column.explanation));
    }
    out += "</tr></thead>\n<tbody>\n";
    for (const SummaryTable::Row& row : table.rows()) {
        out += "<tr>";
        for (const std::size_t c : shown)
            out += fmt::format("<{0}{1}>{2}</{3}>", c == shown.front() ? "th scope=\"row\"" : "td",
                               attributes_of(table.columns()[c], row[c]), markup_text(row[c].text),
                               c == shown.front() ? "th" : "td");
        out += "</tr>\n";
    }
    out += "</tbody></table></div>\n";
    if (!explanations.empty()) out += fmt::format("<dl class=\"key\">{}</dl>\n", explanations);
    return out;
}

SummaryTable::Cell number_cell(double value, int digits, std::string mark) {
    return {significant(value, digits), value, std::move(mark)};
}

SummaryTable::Cell formatted_cell(std::string_view format, double value, std::string mark) {
    return {std::isfinite(value) ? fmt::format(fmt::runtime(format), value) : "", value, std::move(mark)};
}

SummaryTable::Cell estimate_cell(double value, double sd) {
    return {with_digits_of(value, sd), value};
}

std::string html_paragraph(std::string_view text) {
    return text.empty() ? "" : fmt::format("<p>{}</p>\n", markup_text(text));
}

std::string html_headed(int level, std::string_view heading, const std::string& html) {
    return html.empty() ? "" : fmt::format("<h{0}>{1}</h{0}>\n{2}", level, markup_text(heading), html);
}

}  // namespace orbid::apps
