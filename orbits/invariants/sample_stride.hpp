#pragma once

#include <cstddef>

#include "orbits/records/series.hpp"

namespace orbid::orbits {

/// Samples of a flow until the state has moved a tenth of its range (rms over the series, in units of
/// Series::scale()): a step over which maps are simple, and long enough for their errors not to add up over too many.
/// At least 1, at most 1000; 1 without two finite samples in one segment.
[[nodiscard]] std::size_t sample_stride(const Series& series);

/// The map over `stride` samples as a section series: every sample starts a step, so that none is lost as a neighbour.
/// The samples 0, stride, 2 stride, ... of all segments come first: the others tell the same story once more.
[[nodiscard]] Series strided(const Series& series, std::size_t stride);

}  // namespace orbid::orbits
