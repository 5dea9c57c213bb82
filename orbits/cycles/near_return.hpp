#pragma once

#include <span>
#include <string>
#include <vector>

#include "orbits/records/series.hpp"

#pragma GCC visibility push(default)

namespace orbid::orbits {

/// How near a record comes back to itself after some returns to its section.
struct NearReturn {
    int period = 0;         ///< in points of the section
    double distance = 0.0;  ///< largest difference of a coordinate over its range (Series::scale())
    double time = 0.0;      ///< [s] it takes; nan: the section has no times
    double begin = 0.0;     ///< [s] when it begins, or the number of its first point
};

/// The nearest return of every period: for records that are too short for a search. Periods that no segment lasts are
/// left out.
/// @throws std::invalid_argument for samples in time, and periods below 1.
[[nodiscard]] std::vector<NearReturn> near_returns(const Series& section, std::span<const int> periods);

/// "period 2 to 1.3 % of the range, after 11.8 s from 203 s on; ...". Empty without any.
[[nodiscard]] std::string description(const std::vector<NearReturn>& returns);

}  // namespace orbid::orbits

#pragma GCC visibility pop
