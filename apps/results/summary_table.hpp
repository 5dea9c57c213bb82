#pragma once

#include <cstddef>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace orbid::apps {

/// A table of text with aligned columns, two spaces between them, a heading and no rules: for standard output.
///
/// Columns are as wide as their widest cell; a column whose cells are all empty is left out.
class SummaryTable {
public:
    enum class Align { left, right };
    struct Column {
        Column(std::string text, Align side = Align::right) : heading(std::move(text)), align(side) {}
        Column(const char* text, Align side = Align::right) : heading(text), align(side) {}
        std::string heading;
        Align align;
    };

    explicit SummaryTable(std::vector<Column> columns) : columns_(std::move(columns)) {}

    /// @throws std::invalid_argument when the number of cells is not that of the columns.
    void add(std::vector<std::string> cells);
    [[nodiscard]] bool empty() const { return rows_.empty(); }
    /// Every line ends in a newline and starts with two spaces; no trailing blanks. Nothing for an empty table.
    [[nodiscard]] std::string text() const;

private:
    std::vector<Column> columns_;
    std::vector<std::vector<std::string>> rows_;
};

/// The heading of a column of words.
[[nodiscard]] inline SummaryTable::Column left_aligned(std::string heading) {
    return {std::move(heading), SummaryTable::Align::left};
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
