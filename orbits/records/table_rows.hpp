#pragma once

#include <cstddef>
#include <limits>
#include <string>
#include <vector>

#include "orbits/records/series_file.hpp"
#include "orbits/records/text_table.hpp"

namespace orbid::orbits {

/// What the rows of a table have become.
struct TableRows {
    Series series;
    std::size_t rows = 0;                                         ///< of the table
    std::size_t lines = 0;                                        ///< the number of its last row's line
    double first_time = std::numeric_limits<double>::infinity();  ///< [s] of all rows that were reached
    double last_time = -std::numeric_limits<double>::infinity();
};

/// The names of all columns that a layout reads, each once.
[[nodiscard]] std::vector<std::string> column_names(const TableLayout& layout);

/// @throws std::invalid_argument as read_csv
void validate_layout(const TableLayout& layout);

/// Reads row after row into segments; there may be none.
/// @throws DataError as read_csv, but for too few points.
[[nodiscard]] TableRows read_rows(TextTable table, const TableLayout& layout);

}  // namespace orbid::orbits
