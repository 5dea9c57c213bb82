#pragma once

#include <time.h>

#include <algorithm>
#include <functional>
#include <limits>
#include <string>

#include <fmt/format.h>
#include <tbb/task_arena.h>
#include <Eigen/Core>

#include "models/system/stopped.hpp"

namespace orbid::apps {

/// Long enough that a clock, and the first touch of the memory, do not matter; short enough to wait for.
inline constexpr double measured_for_s = 0.1;
inline constexpr double longest_s = 1.0;
inline constexpr Eigen::Index first_points = 64;

/// Processor time of this thread [s]: what else runs on the machine does not count.
inline double processor_seconds() {
    timespec now{};
    (void)clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
    return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

/// Seconds per point of what `compute` does with so many: of more and more until it takes long enough, and without what
/// the one before took, so that what comes once does not count.
/// @param compute  returns why it failed; empty: it did not
template <class Compute>
double seconds_per_point(Eigen::Index available, const Compute& compute, std::string& unknown) {
    Eigen::Index count = std::min(first_points, available);
    double before = 0.0, counted_before = 0.0;
    while (true) {
        const double limit = processor_seconds() + longest_s;
        const std::function<bool()> late = [limit] { return processor_seconds() > limit; };
        double took = 0.0;
        try {
            // One thread: others that wait for work would count as well, or do a part that does not.
            tbb::task_arena(1).execute([&] { unknown = compute(count, late, took); });
        } catch (const models::Stopped&) {
            unknown = fmt::format("following the model over {} points takes longer than a second", count);
        }
        if (!unknown.empty()) return std::numeric_limits<double>::quiet_NaN();
        const Eigen::Index more = std::min(4 * count, available);
        // Of two times that differ by little the quotient is chance.
        if (took >= measured_for_s || more == count)
            return std::max((took - before) / (static_cast<double>(count) - counted_before),
                            0.2 * took / static_cast<double>(count));
        before = took;
        counted_before = static_cast<double>(count);
        count = more;
    }
}

}  // namespace orbid::apps
