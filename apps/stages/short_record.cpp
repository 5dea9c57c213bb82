#include "apps/stages/short_record.hpp"

#include <optional>

#include <fmt/format.h>

#include "apps/job/orbits_job.hpp"
#include "orbits/cycles/near_return.hpp"
#include "orbits/local_maps/fit_limits.hpp"
#include "orbits/records/data_error.hpp"
#include "orbits/sections/record_period.hpp"

namespace orbid::apps {

namespace {

/// How a record repeats as a whole; nothing where that cannot be told.
std::optional<orbits::RecordPeriod> period_of(const orbits::Series& samples) {
    if (samples.sampling != orbits::Series::Sampling::samples) return std::nullopt;
    try {
        return orbits::record_period(samples);
    } catch (const orbits::DataError&) {
        return std::nullopt;  // not equidistant
    }
}

std::string instead(const std::optional<orbits::RecordPeriod>& period, const orbits::Series& samples) {
    if (period && period->periodic)
        return fmt::format("The record {}: a residual of type waveform compares it with an orbit of the model.",
                           orbits::description(*period, samples));
    const std::string nearest =
        period && period->time > 0.0 ? fmt::format("The record {}. ", orbits::description(*period, samples)) : "";
    return nearest + "A residual of type series fits a record of any length, without cycles.";
}

}  // namespace

std::vector<std::string> without_cycles(const Job& job, const SearchedSection& section) {
    const OrbitsJob& orbits = *job.orbits;
    const orbits::Series& series = section.series();
    std::vector<std::string> said;
    if (section.stream) return said;  // no short one
    // The same as the search asks for, and for reliable results ten times as much.
    const int neighbours = orbits.search.neighbours > 0 ? orbits.search.neighbours : orbits::default_neighbours;
    said.push_back(
        fmt::format("The section has {} points: a search needs {}, and finds cycles reliably from some "
                    "thousand on.",
                    series.size(), 10 * neighbours));
    if (const std::string returns = orbits::description(orbits::near_returns(series, orbits.search.periods));
        !returns.empty())
        said.push_back(fmt::format("The nearest returns are: {}.", returns));
    said.push_back(instead(period_of(*section.record), *section.record));
    return said;
}

std::string without_section(const orbits::Series& samples) {
    return instead(period_of(samples), samples);
}

}  // namespace orbid::apps
