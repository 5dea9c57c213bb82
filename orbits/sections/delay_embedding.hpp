#pragma once

#include <vector>

#include <Eigen/Core>

#include "models/arithmetic/matrix_layout.hpp"
#include "orbits/records/series.hpp"

#pragma GCC visibility push(default)

namespace orbid::orbits {

struct DelayEmbeddingOptions {
    Eigen::Index coordinate = 0;  ///< the observable; not an angle, but its sine or cosine may be used
    int delay = 0;                ///< [samples]; 0: first minimum of the mutual information
    int dimension = 0;            ///< of the delay vectors; 0: by false neighbours
    int largest_delay = 1000;     ///< [samples], >= 1: largest tried
    int largest_dimension = 8;    ///< >= 1: largest tried
    /// The second coordinate is x(t + delay) - x(t), "x_rise", in the place of x(t + delay): where it is 0 the
    /// observable has an extremum. The vectors then have two coordinates or more.
    bool rise = false;
};

/// States reconstructed from one observable.
struct DelayEmbedding {
    Series series;  ///< samples of (x(t), x(t + delay), ... ), times t
    int delay = 0;  ///< [samples]
    int dimension = 0;
    std::vector<double> mutual_information;  ///< [nat] at the delays tried, 1, 2, ...; empty: delay given
    /// Share of false neighbours in the dimensions tried, 1, 2, ...; empty: dimension given.
    std::vector<double> false_neighbours;
    bool minimum_found = true;  ///< false: no minimum up to largest_delay; `delay` is where it fell to 1/e
    bool unfolded = true;       ///< false: more than 1 % of the neighbours are false even in largest_dimension
};

/// Delay vectors of one observable (Takens 1981).
///
/// Delay: first minimum of the mutual information of x(t) and x(t + delay) (Fraser and Swinney 1986), from counts in
/// equally probable bins. A minimum counts when it lies below the next three values by more than the scatter of the
/// counts. Dimension: the first in which at most 1 % of the nearest neighbours are false (Kennel, Brown and Abarbanel
/// 1992): the next coordinate separates them by more than 15 times their distance, or to more than twice the
/// observable's sd. Neighbours in time (within the length of a delay vector) are excluded. At most 2 10^4 vectors are
/// compared.
///
/// A missing sample is missing in every vector that contains it. No vector extends past the end of a segment; segments
/// shorter than a vector are left out.
///
/// @throws std::invalid_argument for sections, a coordinate that does not exist or is an angle, options out of range;
///         DataError for fewer than 500 samples, no segment as long as a vector.
[[nodiscard]] DelayEmbedding embed(const Series& samples, const DelayEmbeddingOptions& options = {});

}  // namespace orbid::orbits

#pragma GCC visibility pop
