#pragma once

#include <cstddef>
#include <limits>
#include <string>

#include "orbits/records/series.hpp"

#pragma GCC visibility push(default)

namespace orbid::orbits {

/// The part of a record that is read. What lies outside is not looked at: it may hold gaps and bad readings.
struct RecordPart {
    /// Rows of the file from 1, both included; header, comments and empty lines do not count.
    std::size_t first_row = 1;
    std::size_t last_row = std::numeric_limits<std::size_t>::max();
    /// Times [s] as the file states them, both included; a record without times has no window.
    double begin = -std::numeric_limits<double>::infinity();
    double end = std::numeric_limits<double>::infinity();
    std::size_t every = 1;  ///< of what is left of a segment: the first row, and one in so many rows after it

    [[nodiscard]] bool windowed() const {
        return begin > -std::numeric_limits<double>::infinity() || end < std::numeric_limits<double>::infinity();
    }
};

/// @param timed  whether the record has times
/// @throws std::invalid_argument when rows or times do not ascend, `every` is 0 or leaves out points of a section, or
///         there is a window without times.
void validate_part(const RecordPart& part, Series::Sampling sampling, bool timed);

/// Chooses row after row.
class RowChoice {
public:
    explicit RowChoice(const RecordPart& part) : part_(part) {}

    /// The next rows belong to another segment.
    void begin_segment() { within_ = 0; }
    /// Whether a row, numbered from 1, is among the rows; its time need not be known.
    [[nodiscard]] bool reaches(std::size_t row) const { return row >= part_.first_row && row <= part_.last_row; }
    /// Whether a row that is reached is read; each is asked for once, in order.
    /// @param time  [s]; anything without a window
    [[nodiscard]] bool takes(double time) {
        if (part_.windowed() && !(time >= part_.begin && time <= part_.end)) return false;
        return within_++ % part_.every == 0;
    }

private:
    RecordPart part_;
    std::size_t within_ = 0;
};

/// The part of a series; segments of which nothing is left are left out.
/// @param source  what is read, named in errors
/// @throws DataError when nothing is left, or the series has no times for a window; std::invalid_argument as
///         validate_part does.
[[nodiscard]] Series part_of(Series series, const RecordPart& part, const std::string& source);

/// What to say when nothing is left of a record with this many rows, in which those that were reached had these times.
[[nodiscard]] std::string nothing_left(const std::string& source, const RecordPart& part, std::size_t rows,
                                       double first_time, double last_time);

}  // namespace orbid::orbits

#pragma GCC visibility pop
