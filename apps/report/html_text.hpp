#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace orbid::apps {

/// A table of a page: caption, headings with scope, the first column names its row. Columns whose cells are all empty
/// are left out, as in SummaryTable.
class HtmlTable {
public:
    struct Column {
        std::string heading;
        bool number = true;            ///< set flush right, in figures of equal width
        std::string explanation = {};  ///< shown under the table, after the heading's name
    };
    struct Cell {
        std::string text;                  ///< plain; escaped here
        std::optional<double> value = {};  ///< what the column sorts by, where the text is no plain number
        std::string mark = {};             ///< class of the cell, for its look: "good", "caution"
        Cell(std::string text_) : text(std::move(text_)) {}
        Cell(const char* text_) : text(text_) {}
        Cell(std::string text_, double value_, std::string mark_ = {})
            : text(std::move(text_)), value(value_), mark(std::move(mark_)) {}
    };

    /// @param caption  plain text, what the table holds.
    HtmlTable(std::string caption, std::vector<Column> columns)
        : caption_(std::move(caption)), columns_(std::move(columns)) {}

    /// @throws std::invalid_argument when the number of cells is not that of the columns.
    void add(std::vector<Cell> cells);
    /// Nothing for a table without rows. Tables of three rows and more sort where scripts run.
    [[nodiscard]] std::string html() const;

private:
    std::string caption_;
    std::vector<Column> columns_;
    std::vector<std::vector<Cell>> rows_;
};

/// A number with `digits` significant digits, which its column sorts by.
[[nodiscard]] HtmlTable::Cell number_cell(double value, int digits, std::string mark = {});

/// A value with as many digits as its sd supports.
[[nodiscard]] HtmlTable::Cell estimate_cell(double value, double sd);

/// A paragraph of plain text; nothing for an empty one.
[[nodiscard]] std::string html_paragraph(std::string_view text);

/// A heading with what stands below it; nothing where that is empty.
/// @param level  2 to 4.
[[nodiscard]] std::string html_headed(int level, std::string_view heading, const std::string& html);

}  // namespace orbid::apps
