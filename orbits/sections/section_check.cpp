#include "orbits/sections/section_check.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <optional>
#include <stdexcept>

#include <fmt/format.h>

#include "orbits/records/refusal.hpp"
#include "periodic/orbit/full_turn.hpp"

namespace orbid::orbits {
namespace {

// Points looked at for steps, repetitions and jumps.
constexpr std::size_t most_points = 100000;

// Fewer different readings than these hold no map.
constexpr std::size_t least_different = 16;

// A coordinate is read in steps when at least this part of its readings repeats an earlier one.
constexpr double tied = 0.5;

// Repeated points up to this share are no matter.
constexpr double few = 0.01;

// A span this near to a whole turn may be that of an angle.
constexpr double nearly = 0.03;

// Neighbours whose images differ by more than this part of the span lie on either side of a seam; so many of them are
// no accident.
constexpr double across = 0.9;
constexpr std::size_t seam_pairs = 5;

struct Range {
    double low = std::numeric_limits<double>::infinity(), high = -low;
    std::size_t count = 0;
    [[nodiscard]] double span() const { return high - low; }
};

Range range_of(const Series& series, Eigen::Index d) {
    Range range;
    for (const Segment& segment : series.segments)
        for (const double value : segment.values.row(d)) {
            if (!std::isfinite(value)) continue;
            range.low = std::min(range.low, value);
            range.high = std::max(range.high, value);
            ++range.count;
        }
    return range;
}

// A point with its image, and where it is.
struct Pair {
    const Segment* segment;
    Eigen::Index column;
    [[nodiscard]] auto point() const { return segment->values.col(column); }
    [[nodiscard]] auto image() const { return segment->values.col(column + 1); }
};

std::vector<Pair> some_pairs(const Series& series) {
    const std::size_t stride = series.size() / most_points + 1;
    std::vector<Pair> pairs;
    std::size_t number = 0;
    for (const Segment& segment : series.segments)
        for (Eigen::Index i = 0; i + 1 < segment.values.cols(); ++i)
            if (number++ % stride == 0 && segment.values.col(i).allFinite() && segment.values.col(i + 1).allFinite())
                pairs.push_back({&segment, i});
    return pairs;
}

void check_readings(const Series& series) {
    for (Eigen::Index d = 0; d < series.dimension(); ++d) {
        const std::string& name = series.coordinate(d).name;
        const Range range = range_of(series, d);
        refuse_record_if(
            range.count == 0,
            "find_cycles: coordinate '{}' has no readings: all {} of them are missing (nan); leave it out, or "
            "read it from another column",
            name, series.size());
        refuse_record_if(
            !(range.span() > 0.0),
            "find_cycles: coordinate '{}' has no spread: all {} readings are {}; a coordinate must vary, leave "
            "this one out",
            name, range.count, range.low);
    }
}

// Points of the longest piece without a break, and a refusal when it is one.
Eigen::Index longest_piece(const Series& series) {
    Eigen::Index longest = 0, longest_segment = 0;
    for (const Segment& segment : series.segments) {
        longest_segment = std::max(longest_segment, segment.values.cols());
        Eigen::Index run = 0;
        for (Eigen::Index i = 0; i < segment.values.cols(); ++i) {
            run = segment.values.col(i).allFinite() ? run + 1 : 0;
            longest = std::max(longest, run);
        }
    }
    if (longest >= 2) return longest;
    throw DataError(
        longest_segment < 2
            ? fmt::format("find_cycles: none of the {} points has an image, because every segment is a single point; "
                          "the points of one segment follow each other by one section, so a record of successive "
                          "sections must be one segment",
                          series.size())
            : fmt::format("find_cycles: none of the {} points has an image, because no two points that follow each "
                          "other are complete; missing readings (nan) must be the exception",
                          series.size()));
}

void check_periods(const std::vector<int>& periods, Eigen::Index longest, std::vector<std::string>& remarks) {
    const auto [least, most] = std::minmax_element(periods.begin(), periods.end());
    refuse_record_if(
        *least >= longest,
        "find_cycles: period {} needs pieces of at least {} successive points; the longest without a break has {}",
        *least, *least + 1, longest);
    if (*most >= longest)
        remarks.push_back(fmt::format(
            "Periods from {} on cannot recur: the longest piece of the series without a break has {} points.", longest,
            longest));
}

// Readings in steps.
void look_at_steps(const Series& series, const std::vector<Pair>& pairs, std::vector<std::string>& remarks) {
    for (Eigen::Index d = 0; d < series.dimension(); ++d) {
        const SeriesCoordinate& coordinate = series.coordinate(d);
        std::vector<double> readings;
        for (const Pair& pair : pairs)
            readings.push_back(pair.point()[d]);
        std::sort(readings.begin(), readings.end());
        const double span = readings.back() - readings.front();
        double step = span;
        std::size_t different = 1;
        // Steps written with rounded digits differ by a little: not below this part of the span.
        const double rounding = 1e-9 * span;
        for (std::size_t i = 1; i < readings.size(); ++i) {
            const double apart = readings[i] - readings[i - 1];
            if (!(apart > rounding)) continue;
            ++different;
            step = std::min(step, apart);
        }
        refuse_record_if(
            different < least_different && readings.size() > 4 * least_different,
            "find_cycles: coordinate '{}' has only {} different readings at {} points, {} to {} in steps of {}; "
            "at least {} are needed: read it more finely, or leave it out",
            coordinate.name, different, readings.size(), readings.front(), readings.back(), step, least_different);
        const double repeated = 1.0 - static_cast<double>(different) / static_cast<double>(readings.size());
        if (repeated >= tied)
            remarks.push_back(fmt::format(
                "Coordinate '{}' is read in steps of {:.6g}{}{}: each reading is uncertain by at least {:.2g}.",
                coordinate.name, step, coordinate.unit.empty() ? "" : " ", coordinate.unit, step / std::sqrt(12.0)));
    }
}

// Points that occur again with the same image: records that were stored twice, or a motion that has settled.
// What remains is each once.
std::vector<Pair> look_at_repetitions(const std::vector<Pair>& pairs, std::vector<std::string>& remarks) {
    std::vector<Pair> sorted = pairs;
    const auto less = [](const Pair& a, const Pair& b) {
        for (Eigen::Index d = 0; d < a.point().size(); ++d) {
            if (a.point()[d] != b.point()[d]) return a.point()[d] < b.point()[d];
            if (a.image()[d] != b.image()[d]) return a.image()[d] < b.image()[d];
        }
        return false;
    };
    std::stable_sort(sorted.begin(), sorted.end(), less);
    std::size_t repeated = 0;
    std::optional<std::size_t> first;
    std::vector<Pair> once{sorted.front()};
    for (std::size_t i = 1; i < sorted.size(); ++i) {
        if (less(sorted[i - 1], sorted[i])) {
            once.push_back(sorted[i]);
            continue;
        }
        ++repeated;
        if (!first) first = i;
    }
    if (!first || static_cast<double>(repeated) <= few * static_cast<double>(sorted.size())) return once;
    const Pair& a = sorted[*first - 1];
    const Pair& b = sorted[*first];
    remarks.push_back(fmt::format(
        "{} of {} points occur more than once with the same image (point {} of segment '{}' and point {} of "
        "segment '{}' are such): parts of the record were stored twice, or the motion has settled; "
        "repetitions make errors look too small.",
        repeated, sorted.size(), a.column + 1, a.segment->label, b.column + 1, b.segment->label));
    return once;
}

// Neighbours whose images lie at opposite ends of the coordinate's range.
std::size_t torn_neighbours(const std::vector<Pair>& pairs, Eigen::Index d, double span) {
    // Neighbours along the coordinate with the most places to be told apart would do in one dimension; in several, the
    // nearest of the points that follow in that order.
    const Eigen::Index n = pairs.front().point().size();
    Eigen::VectorXd scale = Eigen::VectorXd::Zero(n), low = pairs.front().point(), high = low;
    for (const Pair& pair : pairs) {
        low = low.cwiseMin(pair.point());
        high = high.cwiseMax(pair.point());
    }
    scale = (high - low).cwiseMax(std::numeric_limits<double>::min());
    std::vector<Pair> sorted = pairs;
    std::stable_sort(sorted.begin(), sorted.end(),
                     [](const Pair& a, const Pair& b) { return a.point()[0] < b.point()[0]; });
    constexpr std::size_t ahead = 50;
    const double near = 3.0 * std::pow(static_cast<double>(sorted.size()), -1.0 / static_cast<double>(n));
    std::size_t torn = 0;
    for (std::size_t i = 0; i < sorted.size(); ++i)
        for (std::size_t j = i + 1; j < std::min(i + ahead, sorted.size()); ++j) {
            const double distance = (sorted[i].point() - sorted[j].point()).cwiseQuotient(scale).cwiseAbs().maxCoeff();
            if (distance > near) continue;
            torn += std::abs(sorted[i].image()[d] - sorted[j].image()[d]) > across * span ? 1 : 0;
            break;
        }
    return torn;
}

void check_angles(const Series& series, const std::vector<Pair>& pairs, std::vector<std::string>& remarks) {
    for (Eigen::Index d = 0; d < series.dimension(); ++d) {
        const SeriesCoordinate& coordinate = series.coordinate(d);
        const double span = range_of(series, d).span();
        const bool degrees = std::abs(span / 360.0 - 1.0) <= nearly;
        if (coordinate.angle) {
            if (degrees)
                remarks.push_back(
                    fmt::format("Coordinate '{}' is declared an angle, which is in radians, but its readings span "
                                "{:.6g} as degrees "
                                "do.",
                                coordinate.name, span));
            continue;
        }
        if (!degrees && !(std::abs(span / periodic::full_turn - 1.0) <= nearly)) continue;
        const std::size_t torn = torn_neighbours(pairs, d, span);
        if (torn < seam_pairs) continue;
        throw DataError(fmt::format(
            "find_cycles: coordinate '{}' spans {:.6g}, and at {} places the images of neighbouring points differ by "
            "nearly all of it: it is an angle {}, but is not declared as one; declare it an angle{}",
            coordinate.name, span, torn, degrees ? "in degrees" : "in radians",
            degrees ? " and convert it to radians" : ""));
    }
}

}  // namespace

std::vector<std::string> check_section(const Series& series, const std::vector<int>& periods) {
    std::vector<std::string> remarks;
    // What is no section at all is refused by SectionPoints.
    if (series.sampling != Series::Sampling::section || series.dimension() < 1 || periods.empty() ||
        std::any_of(series.segments.begin(), series.segments.end(),
                    [&](const Segment& segment) { return segment.values.rows() != series.dimension(); }))
        return remarks;
    check_readings(series);
    check_periods(periods, longest_piece(series), remarks);
    const std::vector<Pair> pairs = some_pairs(series);
    if (pairs.empty()) return remarks;
    look_at_steps(series, look_at_repetitions(pairs, remarks), remarks);
    check_angles(series, pairs, remarks);
    return remarks;
}

void check_neighbours(std::size_t images, int neighbours, std::size_t usual, Eigen::Index least) {
    refuse_if(neighbours != 0 && !(neighbours >= least),
              "find_cycles: neighbours must be at least {} for this order and dimension, got {}", least, neighbours);
    const std::size_t needed = 10 * (neighbours > 0 ? static_cast<std::size_t>(neighbours) : usual);
    refuse_record_if(!(images >= needed),
                     "find_cycles: needs at least 10 x neighbours = {} points with an image, got {}", needed, images);
}

}  // namespace orbid::orbits
