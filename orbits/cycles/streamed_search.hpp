#pragma once

#include <cstddef>

#include "orbits/cycles/cycle.hpp"
#include "orbits/cycles/cycle_search.hpp"
#include "orbits/records/series_stream.hpp"

namespace orbid::orbits {

/// Unstable periodic orbits of a record that need not fit into memory.
///
/// A record that fits is read and searched: the result is that of find_cycles(series, options), to the byte. Of a
/// larger one, stretches that fit, evenly spaced, are searched; then the record is read once more in blocks, keeping
/// those points with their images that lie near the cycles found, and every cycle is refined on all of them. Cycles
/// that only the whole record would show are not found; those found are as accurate as the whole record allows, as far
/// as local maps refine them (cycles of a patch map, a sheet or a closest return stay as the stretches tell).
/// Cycle::recurrences and CycleSearch::candidates count what the stretches hold. More cycles than fit near their points
/// are refined in several readings. CycleSearch::remarks says what was done.
///
/// @param memory  [byte] for the points and the search; the program itself comes on top.
/// @throws std::invalid_argument as find_cycles(series, options), and when fewer than 2^14 points fit into `memory`;
///         DataError when the record cannot be read.
[[nodiscard]] CycleSearch find_cycles(const SeriesStream& record, const CycleSearchOptions& options,
                                      std::size_t memory);

}  // namespace orbid::orbits
