#include "apps/job/segment_choice.hpp"

#include <algorithm>

#include <fmt/format.h>

#include "orbits/records/data_error.hpp"

namespace orbid::apps {

std::vector<std::size_t> segments_with(const orbits::Series& series, const DataJob& data,
                                       const std::vector<std::string>& labels) {
    std::vector<std::size_t> found;
    for (const std::string& label : labels) {
        const auto segment = std::find_if(series.segments.begin(), series.segments.end(),
                                          [&](const orbits::Segment& one) { return one.label == label; });
        if (segment == series.segments.end())
            throw orbits::DataError(fmt::format("{}: there is no segment \"{}\"", data.name, label));
        found.push_back(static_cast<std::size_t>(segment - series.segments.begin()));
    }
    return found;
}

std::vector<std::size_t> fitted_segments(const orbits::Series& series, const DataJob& data) {
    if (data.fit) return segments_with(series, data, *data.fit);
    const auto predicted = segments_with(series, data, data.predict);
    std::vector<std::size_t> rest;
    for (std::size_t s = 0; s < series.segments.size(); ++s)
        if (std::find(predicted.begin(), predicted.end(), s) == predicted.end()) rest.push_back(s);
    return rest;
}

}  // namespace orbid::apps
