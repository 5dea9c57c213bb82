#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace orbid::orbits {

/// Whether a file is one of Matlab, told by its ending ".mat".
[[nodiscard]] bool is_matlab_file(const std::filesystem::path& file);

/// Columns of equal length in a Matlab file (format 4, 5 or 7.3), as a text table with commas: a header, one row per
/// sample, an empty cell for NaN.
///
/// A column is a vector of real numbers, lying or standing: "y"; a column or row of a matrix: "y(:,2)", "y(2,:)"; or
/// one of these in a structure: "run.y". Numbers of single precision and integers become doubles.
/// @param names  the columns that are wanted; none: all of the longest length.
/// @throws DataError naming file and variable: file missing, a folder or no Matlab file; no such variable (with the
///         nearest that exists); no real numbers in one or two dimensions; no such column; lengths that differ.
[[nodiscard]] std::string matlab_table(const std::filesystem::path& file, const std::vector<std::string>& names);

}  // namespace orbid::orbits
