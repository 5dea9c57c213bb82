#pragma once

#include <cstddef>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "models/arithmetic/matrix_layout.hpp"
#include "orbits/cycles/cycle.hpp"
#include "orbits/records/series.hpp"

#pragma GCC visibility push(default)

namespace orbid::orbits {

/// The readings along a cycle of a sampled motion, over one period from its first point on.
struct CycleWaveform {
    std::size_t cycle = 0;       ///< index into the list
    int period = 0;              ///< of the section
    double time = 0.0;           ///< T [s]
    double time_sd = 0.0;        ///< [s]
    Eigen::VectorXd times;       ///< shape (m) [s], from 0, below T
    Eigen::MatrixXd values;      ///< shape (c, m); nan = missing
    Eigen::MatrixXd deviations;  ///< sds, shape (c, m), > 0
};

/// The waveforms of cycles that were found in a section cut from samples.
///
/// From the points of the section nearest to point j of a cycle, the record is followed to the next crossing, which it
/// reaches after R. Readings at equal shares of R, and R itself, are fitted by polynomials of order 1 or 2 in the
/// displacement from the cycle's point; their values at the point are those of the cycle. Order and number of
/// neighbours are those with the least predicted error. The sds hold that error and what that of the point adds.
/// Readings that the section itself tells are missing. The pieces of all p points make one period. Readings between
/// samples are those of smoothing polynomials in time (best_window()).
///
/// Nothing but the record is needed: its coordinates may be delays of one reading, and the state unknown.
///
/// @param samples      the record
/// @param coordinates  of the record, whose readings are followed
/// @param section      of that record, with times; labels of its pieces are those of the segments they are cut from
/// @return those of cycles of which the record has enough passages
/// @throws std::invalid_argument for a record of sections, a section without times, or of another dimension than the
///         cycles; DataError for samples that are not equidistant.
[[nodiscard]] std::vector<CycleWaveform> cycle_waveforms(const Series& samples,
                                                         std::span<const Eigen::Index> coordinates,
                                                         const Series& section, const std::vector<Cycle>& cycles,
                                                         const std::function<bool()>& interrupted = {});

}  // namespace orbid::orbits

#pragma GCC visibility pop
