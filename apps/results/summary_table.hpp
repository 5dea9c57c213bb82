#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace orbid::apps {

/// A table with a heading above each column: as text for standard output, or by html_table() in a page.
///
/// Columns whose cells are all empty are left out.
class SummaryTable {
public:
    enum class Align { left, right };
    struct Column {
        Column(std::string text, Align side = Align::right) : heading(std::move(text)), align(side) {}
        Column(const char* text, Align side = Align::right) : heading(text), align(side) {}
        std::string heading;
        Align align;
        std::string explanation = {};  ///< in pages: shown under the table, after the heading's name
    };
    struct Cell {
        std::string text;
        std::optional<double> value = {};  ///< in pages: what the column sorts by, where the text is no plain number
        std::string mark = {};             ///< in pages: class of the cell, for its look: "good", "caution"
        Cell(std::string text_) : text(std::move(text_)) {}
        Cell(const char* text_) : text(text_) {}
        Cell(std::string text_, double value_, std::string mark_ = {})
            : text(std::move(text_)), value(value_), mark(std::move(mark_)) {}
    };
    using Row = std::vector<Cell>;

    explicit SummaryTable(std::vector<Column> columns) : columns_(std::move(columns)) {}

    /// @throws std::invalid_argument when the number of cells is not that of the columns.
    void add(Row cells);
    [[nodiscard]] const std::vector<Column>& columns() const { return columns_; }
    [[nodiscard]] const std::vector<Row>& rows() const { return rows_; }
    [[nodiscard]] bool empty() const { return rows_.empty(); }
    /// Whether a column has a cell that is not empty.
    [[nodiscard]] bool shows(std::size_t column) const;
    /// Columns as wide as their widest cell, two spaces between them, no rules. Every line ends in a newline and starts
    /// with two spaces; no trailing blanks. Nothing for an empty table.
    [[nodiscard]] std::string text() const;

private:
    std::vector<Column> columns_;
    std::vector<Row> rows_;
};

/// The heading of a column of words.
[[nodiscard]] inline SummaryTable::Column left_aligned(std::string heading) {
    return {std::move(heading), SummaryTable::Align::left};
}

/// A heading that a page explains.
[[nodiscard]] inline SummaryTable::Column explained(SummaryTable::Column column, std::string explanation) {
    column.explanation = std::move(explanation);
    return column;
}

/// Characters of UTF-8 text as shown, for texts without combining or wide characters.
[[nodiscard]] std::size_t shown_width(std::string_view text);

/// A value with as many digits as its standard deviation supports: the sd's first two digits are the last ones shown.
/// Without a usable sd (nan, 0): six significant digits. "undefined" for nan.
[[nodiscard]] std::string with_digits_of(double value, double sd);

/// A number with `digits` significant digits; "" for nan.
[[nodiscard]] std::string significant(double value, int digits);

/// A relative deviation in percent with sign, three significant digits: "+0.00032 %"; "" for nan.
[[nodiscard]] std::string percent(double relative);

/// A heading above a table; nothing for an empty body.
[[nodiscard]] std::string titled(std::string_view heading, const std::string& body);

}  // namespace orbid::apps
