#pragma once

#include <string>
#include <vector>

#include "orbits/records/series.hpp"

namespace orbid::orbits {

/// Checks a section series before anything is fitted to it.
///
/// Refused are: a coordinate without a single reading, or with the same one everywhere, or with fewer than 16 different
/// ones; points without any image (every segment a single point, or holes between them); periods that are all longer
/// than any uninterrupted piece; a coordinate that spans 2 pi (or 360) and in which images of neighbouring points jump
/// by that span: it must be an angle but is not declared as one.
///
/// Remarks, one complete sentence each, are made on: readings in steps (with the step), points that occur more than
/// once with the same image, periods that are too long for any piece, an angle whose readings span 360 as degrees do.
///
/// Steps, repetitions and jumps are sought among at most 10^5 evenly spread points.
///
/// @param periods  requested, not empty.
/// @return the remarks.
/// @throws DataError for what is refused: what, where, which rule, and what would be right.
[[nodiscard]] std::vector<std::string> check_section(const Series& series, const std::vector<int>& periods);

/// Checks that a fit has enough neighbours, and ten times as many points with an image (a neighbourhood of more than a
/// tenth of the section is not local).
/// @param neighbours  requested; 0: chosen by the data, `usual` of them are needed.
/// @param least       that the fit needs.
/// @throws std::invalid_argument for too few neighbours; DataError for too few points.
void check_neighbours(std::size_t images, int neighbours, std::size_t usual, Eigen::Index least);

}  // namespace orbid::orbits
