#include <algorithm>
#include <cmath>
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
#include "orbits/records/table_rows.hpp"
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

void check_layout(const TableLayout& layout) {
    if (layout.coordinates.empty()) throw std::invalid_argument("table layout: at least one coordinate is needed");
    std::set<std::string> names;
    for (const CoordinateColumn& column : layout.coordinates) {
        const std::string& name = column.coordinate.name;
        refuse_if(!names.insert(name).second, "table layout: coordinate {} is mapped twice", name);
        refuse_if(!(column.sign == 1.0 || column.sign == -1.0), "column of {}: sign is {}, must be 1 or -1", name,
                  column.sign);
        refuse_if(!(column.factor > 0.0 && std::isfinite(column.factor)), "column of {}: factor is {}, must be > 0",
                  name, column.factor);
        refuse_if(!std::isfinite(column.offset), "column of {}: offset must be a finite number", name);
    }
    const bool samples = layout.sampling == Series::Sampling::samples;
    refuse_if(samples && layout.time.empty() && !(layout.step > 0.0),
              "table layout: samples need a column of times, or their step");
    refuse_if(layout.step != 0.0 && !(samples && layout.time.empty() && layout.step > 0.0),
              "table layout: a step of {} s: must be > 0, for samples without a column of times", layout.step);
    validate_part(layout.part, layout.sampling, !layout.time.empty() || samples);
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
        columns.coordinates.push_back({0, factor * column.factor, column.sign, column.offset, std::nullopt});
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

/// Reads row after row into segments.
class TableReading {
public:
    TableReading(TextTable table, const TableLayout& layout)
        : layout_(layout), columns_(conversions(layout)), table_(std::move(table)), choice_(layout.part) {
        find_columns(table_, layout, columns_);
        with_sds_ = columns_.with_sds();
        series_.sampling = layout.sampling;
        series_.phase = layout.phase;
        for (const CoordinateColumn& column : layout.coordinates)
            series_.coordinates.push_back(column.coordinate);
    }

    TableRows read() {
        std::size_t row = 0;
        while (table_.next(cells_)) {
            if (row % 1024 == 0) models::stop_if_asked(layout_.interrupted);
            follow_segment(row++ == 0);
            if (choice_.reaches(row)) add_row();
            ++row_of_segment_;
        }
        end_segment();
        return {std::move(series_), row, table_.line(), first_time_, last_time_};
    }

private:
    void follow_segment(bool first) {
        if (!columns_.segment || (!first && cells_[*columns_.segment] == label_)) return;
        end_segment();
        label_ = cells_[*columns_.segment];
        if (label_.empty()) table_.fail(*columns_.segment, "is empty; every row needs a segment label");
        if (!labels_.insert(label_).second)
            table_.fail(
                *columns_.segment,
                fmt::format("segment \"{}\" comes back after another one; the rows of a segment must follow each "
                            "other, a new piece needs a new label",
                            label_));
    }

    void add_row() {
        double time = static_cast<double>(row_of_segment_) * layout_.step;
        if (columns_.time) time = table_.number(cells_[*columns_.time], *columns_.time) * columns_.time_factor;
        if (!std::isfinite(time)) table_.fail(*columns_.time, "a time must be a finite number");
        first_time_ = std::min(first_time_, time);
        last_time_ = std::max(last_time_, time);
        if (!choice_.takes(time)) return;
        for (const Reading& reading : columns_.coordinates) {
            rows_.values.push_back(cell_value(table_, cells_[reading.column], reading, layout_));
            if (!with_sds_) continue;
            const std::string_view sd = reading.sd ? cells_[*reading.sd] : std::string_view();
            rows_.deviations.push_back(deviation_of(table_, sd, reading, rows_.values.back()));
        }
        if (columns_.time || layout_.step > 0.0) rows_.times.push_back(time);
        rows_.lines.push_back(table_.line());
    }

    void end_segment() {
        if (!rows_.lines.empty()) {
            if (columns_.time) check_times(table_, *columns_.time, rows_, layout_);
            close_segment(series_, label_, rows_);
        }
        choice_.begin_segment();
        row_of_segment_ = 0;
    }

    const TableLayout& layout_;
    Columns columns_;
    TextTable table_;
    RowChoice choice_;
    Series series_;
    bool with_sds_ = false;
    std::vector<std::string_view> cells_;
    std::unordered_set<std::string> labels_;
    std::string label_ = "0";
    Rows rows_;  ///< of the present segment
    std::size_t row_of_segment_ = 0;
    double first_time_ = std::numeric_limits<double>::infinity();
    double last_time_ = -std::numeric_limits<double>::infinity();
};

void refuse_too_few(const std::string& file, const TableLayout& layout, const TableRows& read) {
    const std::size_t points = read.series.size();
    if (read.rows == 0)
        throw DataError(fmt::format("{}: has a header but no rows; at least {} are needed", file,
                                    std::max<std::size_t>(layout.minimum_points, 1)));
    if (points == 0) throw DataError(nothing_left(file, layout.part, read.rows, read.first_time, read.last_time));
    if (points < layout.minimum_points)
        throw DataError(fmt::format("{}: has {} points, at least {} are needed", file, points, layout.minimum_points));
}

}  // namespace

std::vector<std::string> column_names(const TableLayout& layout) {
    std::vector<std::string> names;
    const auto add = [&names](const std::string& name) {
        if (!name.empty() && std::find(names.begin(), names.end(), name) == names.end()) names.push_back(name);
    };
    add(layout.segment);
    add(layout.time);
    for (const CoordinateColumn& column : layout.coordinates) {
        add(column.column);
        add(column.sd);
    }
    return names;
}

void validate_layout(const TableLayout& layout) {
    check_layout(layout);
    (void)conversions(layout);
}

TableRows read_rows(TextTable table, const TableLayout& layout) {
    return TableReading(std::move(table), layout).read();
}

Series read_csv(const std::filesystem::path& file, const TableLayout& layout) {
    validate_layout(layout);
    TableRows read = read_rows(open_table(file, column_names(layout)), layout);
    refuse_too_few(file.string(), layout, read);
    return std::move(read.series);
}

}  // namespace orbid::orbits
