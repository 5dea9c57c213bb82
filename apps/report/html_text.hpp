#pragma once

#include <string>
#include <string_view>

#include "apps/results/summary_table.hpp"

namespace orbid::apps {

/// A table of a page: caption, headings with scope, explanations below; the first column names its row. Nothing for a
/// table without rows. Tables of three rows and more sort where scripts run.
/// @param caption  plain text, what the table holds.
[[nodiscard]] std::string html_table(std::string_view caption, const SummaryTable& table);

/// A number with `digits` significant digits, which its column sorts by.
[[nodiscard]] SummaryTable::Cell number_cell(double value, int digits, std::string mark = {});

/// The same in a format of fmt ("{:+.2f}"); empty where it is undefined.
[[nodiscard]] SummaryTable::Cell formatted_cell(std::string_view format, double value, std::string mark = {});

/// A value with as many digits as its sd supports.
[[nodiscard]] SummaryTable::Cell estimate_cell(double value, double sd);

/// A paragraph of plain text; nothing for an empty one.
[[nodiscard]] std::string html_paragraph(std::string_view text);

/// A heading with what stands below it; nothing where that is empty.
/// @param level  2 to 4.
[[nodiscard]] std::string html_headed(int level, std::string_view heading, const std::string& html);

}  // namespace orbid::apps
