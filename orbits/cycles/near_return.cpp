#include "orbits/cycles/near_return.hpp"

#include <cmath>
#include <limits>
#include <optional>

#include <fmt/format.h>

#include "orbits/records/refusal.hpp"
#include "periodic/orbit/full_turn.hpp"

namespace orbid::orbits {

using Eigen::Index;

std::vector<NearReturn> near_returns(const Series& section, std::span<const int> periods) {
    refuse_if(section.sampling != Series::Sampling::section, "near_returns: needs points of a section");
    const Eigen::VectorXd scale = section.scale();
    std::vector<NearReturn> found;
    for (const int period : periods) {
        refuse_if(period < 1, "near_returns: periods must be at least 1, got {}", period);
        std::optional<NearReturn> best;
        std::size_t before = 0;
        for (const Segment& segment : section.segments) {
            const bool timed = segment.times.size() > 0;
            for (Index t = 0; t + period < segment.values.cols(); ++t) {
                double largest = 0.0;
                for (Index d = 0; d < section.dimension(); ++d) {
                    double change = segment.values(d, t + period) - segment.values(d, t);
                    if (section.coordinate(d).angle) change = std::remainder(change, periodic::full_turn);
                    // A missing reading is no return.
                    largest = std::isfinite(change) ? std::max(largest, std::abs(change) / scale[d])
                                                    : std::numeric_limits<double>::infinity();
                    if (std::isinf(largest)) break;
                }
                if (!std::isfinite(largest) || (best && largest >= best->distance)) continue;
                best = NearReturn{
                    period, largest,
                    timed ? segment.times[t + period] - segment.times[t] : std::numeric_limits<double>::quiet_NaN(),
                    timed ? segment.times[t] : static_cast<double>(before + static_cast<std::size_t>(t))};
            }
            before += static_cast<std::size_t>(segment.values.cols());
        }
        if (best) found.push_back(*best);
    }
    return found;
}

std::string description(const std::vector<NearReturn>& returns) {
    std::string text;
    for (const NearReturn& one : returns) {
        text += fmt::format("{}period {} to {:.2g} % of the range", text.empty() ? "" : "; ", one.period,
                            100.0 * one.distance);
        text += std::isnan(one.time) ? fmt::format(" from point {} on", static_cast<long>(one.begin))
                                     : fmt::format(", after {:.4g} s from {:.4g} s on", one.time, one.begin);
    }
    return text;
}

}  // namespace orbid::orbits
