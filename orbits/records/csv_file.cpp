#include <algorithm>
#include <cmath>
#include <fstream>
#include <limits>
#include <optional>
#include <set>
#include <stdexcept>
#include <unordered_set>
#include <vector>

#include <fmt/format.h>

#include "models/arithmetic/median.hpp"
#include "models/system/stopped.hpp"
#include "orbits/records/refusal.hpp"
#include "orbits/records/series_file.hpp"
#include "orbits/records/text_table.hpp"
#include "orbits/records/unit.hpp"

namespace orbid::orbits {
namespace {

/// One column to be read: where it stands and how its numbers become values.
struct Reading {
    std::size_t column = 0;
    double factor = 1.0;
    double sign = 1.0;
    double offset = 0.0;
    std::optional<std::size_t> sd;  ///< column of the readings' sds
};

/// What is read from a table, and how its numbers become values.
struct Columns {
    std::vector<Reading> coordinates;
    std::optional<std::size_t> segment, time;
    double time_factor = 1.0;

    [[nodiscard]] bool with_sds() const {
        return std::any_of(coordinates.begin(), coordinates.end(),
                           [](const Reading& one) { return one.sd.has_value(); });
    }
};

/// Points of the segment that is being read, row after row, and the lines they came from.
struct Rows {
    std::vector<double> values;
    std::vector<double> deviations;  ///< like values; empty when no column of sds is read
    std::vector<double> times;
    std::vector<std::size_t> lines;
};

double factor_of(const std::string& unit, const std::string& wanted, const std::string& name) {
    const auto factor = unit_factor(unit, wanted);
    if (!factor) {
        throw std::invalid_argument(fmt::format("column of {}: unit \"{}\" cannot be turned into {}; known: {}", name,
                                                unit, wanted, units_like(wanted)));
    }
    return *factor;
}

void validate_layout(const TableLayout& layout) {
    if (layout.coordinates.empty()) throw std::invalid_argument("table layout: at least one coordinate is needed");
    std::set<std::string> names;
    for (const CoordinateColumn& column : layout.coordinates) {
        const std::string& name = column.coordinate.name;
        refuse_if(!names.insert(name).second, "table layout: coordinate {} is mapped twice", name);
        refuse_if(!(column.sign == 1.0 || column.sign == -1.0), "column of {}: sign is {}, must be 1 or -1", name,
                  column.sign);
        refuse_if(!std::isfinite(column.offset), "column of {}: offset must be a finite number", name);
    }
    refuse_if(layout.sampling == Series::Sampling::samples && layout.time.empty(),
              "table layout: samples need a column of times");
    if (!(layout.time_tolerance > 0.0 && layout.time_tolerance < 1.0)) {
        throw std::invalid_argument(
            fmt::format("table layout: time tolerance is {}, must lie in (0, 1)", layout.time_tolerance));
    }
}

double cell_value(const TextTable& table, std::string_view cell, const Reading& reading, const TableLayout& layout) {
    constexpr double missing = std::numeric_limits<double>::quiet_NaN();
    if (layout.complete && cell.empty()) table.fail(reading.column, "is empty; this column must be complete");
    if (cell.empty()) return missing;
    const double number = table.number(cell, reading.column);
    if (!std::isfinite(number)) {
        if (std::isnan(number) && layout.nan_is_missing && !layout.complete) return missing;
        std::string_view rule = "; a missing sample is an empty cell";
        if (std::isnan(number))
            rule = "; a missing sample is an empty cell, or declare that nan means missing (\"missing\": \"nan\")";
        if (layout.complete) rule = "; this column must be complete";
        table.fail(reading.column, fmt::format("\"{}\" is not a finite number{}", cell, rule));
    }
    return reading.sign * (number * reading.factor - reading.offset);
}

/// The sd of a reading; nan where the reading is missing, whatever stands there.
double deviation_of(const TextTable& table, std::string_view cell, const Reading& reading, double value) {
    if (!reading.sd || std::isnan(value)) return std::numeric_limits<double>::quiet_NaN();
    const double number = cell.empty() ? 0.0 : table.number(cell, *reading.sd) * std::abs(reading.factor);
    if (number > 0.0 && std::isfinite(number)) return number;
    table.fail(*reading.sd, fmt::format("\"{}\" is the sd of a reading that is there: must be a number > 0", cell));
}

/// Times of a segment ascend, samples in equal steps. The median step is the measure: it stays right when rows are
/// missing.
void check_times(const TextTable& table, std::size_t column, const Rows& rows, const TableLayout& layout) {
    const double tolerance = layout.time_tolerance;
    std::vector<double> steps;
    for (std::size_t k = 1; k < rows.times.size(); ++k) {
        const double step = rows.times[k] - rows.times[k - 1];
        if (!(step > 0.0)) {
            table.fail(rows.lines[k], column,
                       fmt::format("time {} s follows {} s; times must ascend within a segment", rows.times[k],
                                   rows.times[k - 1]));
        }
        steps.push_back(step);
    }
    const bool equidistant = layout.sampling == Series::Sampling::samples && layout.equidistant;
    if (steps.empty() || !equidistant) return;
    const double median = models::upper_median(std::move(steps));
    for (std::size_t k = 1; k < rows.times.size(); ++k) {
        const double step = rows.times[k] - rows.times[k - 1];
        if (!(std::abs(step - median) <= tolerance * median)) {
            table.fail(
                rows.lines[k], column,
                fmt::format(
                    "time step {:.6g} s where the segment has {:.6g} s (tolerance {} %); samples must be equidistant: "
                    "leave the cells of a missing sample empty, or begin a new segment after a gap",
                    step, median, 100.0 * tolerance));
        }
    }
}

void close_segment(Series& series, const std::string& label, Rows& rows) {
    const Eigen::Index n = series.dimension();
    const auto points = static_cast<Eigen::Index>(rows.lines.size());
    Segment segment;
    segment.label = label;
    segment.values = Eigen::Map<const Eigen::MatrixXd>(rows.values.data(), n, points);
    segment.times = Eigen::Map<const Eigen::VectorXd>(rows.times.data(), static_cast<Eigen::Index>(rows.times.size()));
    if (!rows.deviations.empty())
        segment.deviations = Eigen::Map<const Eigen::MatrixXd>(rows.deviations.data(), n, points);
    series.segments.push_back(std::move(segment));
    rows.values.clear();
    rows.deviations.clear();
    rows.times.clear();
    rows.lines.clear();
}

/// Factors of the units come first: a layout that fits no table at all is refused before any file is opened.
Columns conversions(const TableLayout& layout) {
    Columns columns;
    for (const CoordinateColumn& column : layout.coordinates) {
        const double factor = factor_of(column.unit, column.coordinate.unit, column.coordinate.name);
        columns.coordinates.push_back({0, factor, column.sign, column.offset, std::nullopt});
    }
    if (!layout.time.empty()) columns.time_factor = factor_of(layout.time_unit, "s", "time");
    return columns;
}

void find_columns(const TextTable& table, const TableLayout& layout, Columns& columns) {
    for (std::size_t i = 0; i < layout.coordinates.size(); ++i) {
        const CoordinateColumn& column = layout.coordinates[i];
        columns.coordinates[i].column = table.column(column.column);
        if (!column.sd.empty()) columns.coordinates[i].sd = table.column(column.sd);
    }
    if (!layout.segment.empty()) columns.segment = table.column(layout.segment);
    if (!layout.time.empty()) columns.time = table.column(layout.time);
}

void add_row(const TextTable& table, const std::vector<std::string_view>& cells, const Columns& columns,
             const TableLayout& layout, bool with_sds, Rows& rows) {
    for (const Reading& reading : columns.coordinates) {
        rows.values.push_back(cell_value(table, cells[reading.column], reading, layout));
        if (!with_sds) continue;
        const std::string_view sd = reading.sd ? cells[*reading.sd] : std::string_view();
        rows.deviations.push_back(deviation_of(table, sd, reading, rows.values.back()));
    }
    if (columns.time) {
        const double time = table.number(cells[*columns.time], *columns.time) * columns.time_factor;
        if (!std::isfinite(time)) table.fail(*columns.time, "a time must be a finite number");
        rows.times.push_back(time);
    }
    rows.lines.push_back(table.line());
}

}  // namespace

Series read_csv(const std::filesystem::path& file, const TableLayout& layout) {
    validate_layout(layout);
    Columns columns = conversions(layout);
    TextTable table(file);
    find_columns(table, layout, columns);
    Series series;
    series.sampling = layout.sampling;
    series.phase = layout.phase;
    for (const CoordinateColumn& column : layout.coordinates)
        series.coordinates.push_back(column.coordinate);

    const bool with_sds = columns.with_sds();
    std::vector<std::string_view> cells;
    std::unordered_set<std::string> labels;
    std::string label = "0";
    Rows rows;
    std::size_t points = 0;
    const auto finish = [&] {
        if (columns.time) check_times(table, *columns.time, rows, layout);
        close_segment(series, label, rows);
    };
    for (; table.next(cells); ++points) {
        if (points % 1024 == 0) models::stop_if_asked(layout.interrupted);
        if (columns.segment && (points == 0 || cells[*columns.segment] != label)) {
            if (points > 0) finish();
            label = cells[*columns.segment];
            if (label.empty()) table.fail(*columns.segment, "is empty; every row needs a segment label");
            if (!labels.insert(label).second)
                table.fail(
                    *columns.segment,
                    fmt::format("segment \"{}\" comes back after another one; the rows of a segment must follow each "
                                "other, a new piece needs a new label",
                                label));
        }
        add_row(table, cells, columns, layout, with_sds, rows);
    }
    if (points == 0)
        throw DataError(fmt::format("{}: has a header but no rows; at least {} are needed", table.file(),
                                    std::max<std::size_t>(layout.minimum_points, 1)));
    finish();
    if (points < layout.minimum_points)
        throw DataError(
            fmt::format("{}: has {} points, at least {} are needed", table.file(), points, layout.minimum_points));
    return series;
}

std::string read_origin(const std::filesystem::path& file) {
    if (file.extension() != ".csv") return read_hdf5(file).origin;
    constexpr std::string_view mark = "# origin: ";  // as write_csv puts it, on the first line
    std::ifstream in(file, std::ios::binary);
    if (!in) throw DataError(fmt::format("{}: cannot be opened", file.string()));
    std::string line;
    std::getline(in, line);
    return line.starts_with(mark) ? line.substr(mark.size()) : std::string();
}

TableLayout table_layout(const Series& series) {
    TableLayout layout;
    layout.sampling = series.sampling;
    layout.phase = series.phase;
    layout.segment = "segment";
    if (series.timed()) layout.time = std::string("t");
    for (const SeriesCoordinate& coordinate : series.coordinates)
        layout.coordinates.push_back({coordinate, coordinate.name, coordinate.unit, 1.0, 0.0, {}});
    return layout;
}

}  // namespace orbid::orbits
