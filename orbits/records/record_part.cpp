#include "orbits/records/record_part.hpp"

#include <algorithm>
#include <limits>
#include <vector>

#include <fmt/format.h>

#include "orbits/records/data_error.hpp"
#include "orbits/records/refusal.hpp"
#include "orbits/records/series_file.hpp"

namespace orbid::orbits {

void validate_part(const RecordPart& part, Series::Sampling sampling, bool timed) {
    refuse_if(part.first_row < 1 || part.last_row < part.first_row, "rows {} to {}: must be 1 <= first <= last",
              part.first_row, part.last_row);
    refuse_if(!(part.begin < part.end), "window from {} s to {} s: must ascend", part.begin, part.end);
    refuse_if(part.windowed() && !timed, "a window in time of a record without times");
    refuse_if(part.every < 1, "every {} rows: must be >= 1", part.every);
    refuse_if(part.every > 1 && sampling == Series::Sampling::section,
              "every {} rows of a section: its points must follow each other", part.every);
}

std::string nothing_left(const std::string& source, const RecordPart& part, std::size_t rows, double first_time,
                         double last_time) {
    if (part.first_row > rows) return fmt::format("{}: has {} rows, none from row {} on", source, rows, part.first_row);
    return fmt::format("{}: no row between {} s and {} s; its times reach from {} s to {} s", source, part.begin,
                       part.end, first_time, last_time);
}

Series part_of(Series series, const RecordPart& part, const std::string& source) {
    validate_part(part, series.sampling, true);
    if (part.windowed() && !series.timed())
        throw DataError(fmt::format("{}: has no times, of which a window could be read", source));
    std::vector<Segment> segments;
    RowChoice choice(part);
    std::size_t row = 0;
    double first = std::numeric_limits<double>::infinity(), last = -first;
    for (const Segment& segment : series.segments) {
        std::vector<Eigen::Index> taken;
        choice.begin_segment();
        for (Eigen::Index k = 0; k < segment.values.cols(); ++k) {
            if (!choice.reaches(++row)) continue;
            const double time = segment.times.size() > 0 ? segment.times[k] : 0.0;
            first = std::min(first, time);
            last = std::max(last, time);
            if (choice.takes(time)) taken.push_back(k);
        }
        if (taken.empty()) continue;
        Segment kept{segment.label, segment.values(Eigen::all, taken), {}, {}};
        if (segment.times.size() > 0) kept.times = segment.times(taken);
        if (segment.deviations.size() > 0) kept.deviations = segment.deviations(Eigen::all, taken);
        segments.push_back(std::move(kept));
    }
    if (segments.empty()) throw DataError(nothing_left(source, part, row, first, last));
    series.segments = std::move(segments);
    return series;
}

}  // namespace orbid::orbits
