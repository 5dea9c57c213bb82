#pragma once

#include <string>
#include <vector>

#include "orbits/records/series.hpp"

namespace orbid::orbits {

/// Looks at a section series before anything is fitted to it, and says what is wrong with it.
///
/// Refused are: a coordinate without a single reading, or with the same one everywhere, or with fewer than 16 different
/// ones; points none of which has an image (every segment a single point, or holes between them); periods all of which
/// are longer than any uninterrupted piece; a coordinate that spans 2 pi (or 360) and at which the images of
/// neighbouring points jump by that span, so that it must be an angle but is not declared as one.
///
/// Remarks, one whole sentence each, are made on: readings in steps (with the step), points that occur more than once
/// with the same image, periods that are too long for any piece, an angle whose readings span 360 as degrees do.
///
/// Steps, repetitions and jumps are looked for among at most 10^5 points, evenly spread.
///
/// @param periods  asked for, not empty.
/// @return the remarks.
/// @throws std::invalid_argument for what is refused: what, where, which rule, and what would be right.
[[nodiscard]] std::vector<std::string> check_section(const Series& series, const std::vector<int>& periods);

/// Neighbours of a fit: as many as it has to have, and ten times as many points with an image (a neighbourhood of more
/// than a tenth of the section is not local).
/// @param neighbours  asked for; 0: left to the data, `usual` of them are needed.
/// @param least       that the fit needs.
/// @throws std::invalid_argument otherwise.
void check_neighbours(std::size_t images, int neighbours, std::size_t usual, Eigen::Index least);

}  // namespace orbid::orbits
