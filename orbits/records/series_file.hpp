#pragma once

#include <cstddef>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "orbits/records/data_error.hpp"
#include "orbits/records/record_part.hpp"
#include "orbits/records/series.hpp"

#pragma GCC visibility push(default)

namespace orbid::orbits {

/// Where a table holds a coordinate of the series: value = sign * (column * factor * unit - offset).
struct CoordinateColumn {
    SeriesCoordinate coordinate;  ///< what the column becomes
    std::string column;           ///< header of the column
    std::string unit;             ///< of the numbers in the file; empty = the coordinate's own (see unit_factor)
    double sign = 1.0;            ///< +1 or -1
    double offset = 0.0;          ///< [unit of the coordinate], finite: the instrument's reading at the model's zero
    std::string sd = {};          ///< header of a column with the sd of every reading, in `unit`; empty = none
    double factor = 1.0;          ///< > 0, of the instrument: units per number in the file, of a reading and of its sd
};

/// How a table of numbers becomes a Series.
struct TableLayout {
    Series::Sampling sampling = Series::Sampling::section;
    std::vector<CoordinateColumn> coordinates;  ///< at least one; different coordinates
    std::string segment;                        ///< column of segment labels; empty = the whole file is one segment
    std::string time;  ///< column of times; samples need one or a step, sections may have one (times of crossings)
    std::string time_unit = "s";
    double step = 0.0;               ///< [s] interval of samples without a column of times, the first at 0; else 0
    RecordPart part = {};            ///< what is read
    bool nan_is_missing = false;     ///< a cell "nan" is a missing sample like an empty one, instead of an error
    double phase = 0.0;              ///< [rad] becomes Series::phase
    std::size_t minimum_points = 1;  ///< fewer rows than this are an error
    /// Samples: allowed deviation of a segment's times from equal median intervals, as a share of the interval per row,
    /// in (0, 1). This allows rounded times, but not a missing row.
    double time_tolerance = 0.05;
    bool equidistant = true;              ///< samples: false = times need only ascend, as for sections
    bool complete = false;                ///< a missing value is an error, whatever nan_is_missing is
    std::function<bool()> interrupted{};  ///< asked while reading; if it says so, models::Stopped is thrown
};

/// Reads a table in text: a header line with the names of the columns, then one row per line.
///
/// Of a file that ends in ".mat" it reads variables of Matlab (formats 4, 5 and 7.3) by the same names: vectors "y",
/// columns or rows of matrices "y(:,2)", fields of structures "run.y"; NaN is a missing sample. The library matio must
/// be installed.
///
/// The separator is a comma, semicolon or tab, whichever the header has most of. Lines end in LF or CRLF. Empty lines,
/// lines that begin with # and a byte order mark are skipped. Cells may be quoted ("" is a quote inside quotes, a
/// quoted cell ends on its line). Columns that the layout does not name are not read. An empty cell is a missing
/// sample. Consecutive rows with equal segment label form a segment.
///
/// @throws DataError naming file, line and column: file missing, a folder, unreadable or without rows; column missing
///         (with the nearest that exists) or named twice; wrong number of cells; a cell that is no number, nan or
///         infinite; a sd of a present reading that is empty or not > 0; a segment label that recurs; times not
///         ascending or not equidistant; no row in the part; too few points.
/// @throws std::invalid_argument for an invalid layout: no coordinate, one twice, sign other than +-1, offset not
///         finite, unknown unit, samples without times, a window of a record without times, `every` of sections.
[[nodiscard]] Series read_csv(const std::filesystem::path& file, const TableLayout& layout);

/// Writes "segment", for timed series "t", and one column per coordinate. Numbers are the shortest decimals that read
/// back to the same double, missing samples are empty cells. Known sds are not stored: a series made by orbid has none.
/// read_csv with table_layout(series) reads it back bit for bit.
///
/// Writes into `file` directly. For an atomic write pass a temporary name, then rename.
/// @param interrupted  asked every megabyte or so, here and below; if it says so, models::Stopped is thrown
/// @throws DataError when the file cannot be written; std::invalid_argument for infinite values, labels or names with
///         line breaks, or names that are used twice.
void write_csv(const std::filesystem::path& file, const Series& series, const std::function<bool()>& interrupted = {});

/// Series::origin of a file that write_csv or write_hdf5 wrote, told apart by the ending ".csv".
/// Empty when the file does not state its origin.
/// @throws DataError as the readers do.
[[nodiscard]] std::string read_origin(const std::filesystem::path& file);

/// The layout of what write_csv(series) writes.
[[nodiscard]] TableLayout table_layout(const Series& series);

/// Reads what write_hdf5 wrote (format "orbid-series/1"), bit for bit.
///
/// @throws DataError naming the file and the object in it: file missing or a folder, not HDF5, another format, an
///         attribute or a dataset missing or of the wrong shape or type, infinite values, fewer than minimum_points.
[[nodiscard]] Series read_hdf5(const std::filesystem::path& file, std::size_t minimum_points = 1,
                               const std::function<bool()>& interrupted = {});

/// Writes format "orbid-series/1":
///
///     /                attributes format, sampling ("section" or "samples"), phase [rad], coordinates, units, angles
///     /segments/000000 dataset (points, coordinates), attribute label; one per segment, in order
///     /times/000000    dataset (points) [s], for timed series
///     /origin          one text, when the series has an origin
///
/// Nothing in the file depends on the time of writing: equal series give equal bytes. Writes directly, as write_csv.
/// @throws DataError when the file cannot be written; std::invalid_argument for a series whose parts have different
///         shapes.
void write_hdf5(const std::filesystem::path& file, const Series& series, const std::function<bool()>& interrupted = {});

}  // namespace orbid::orbits

#pragma GCC visibility pop
