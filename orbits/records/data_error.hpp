#pragma once

#include "models/definition/wrong_data.hpp"

namespace orbid::orbits {

/// Recorded data that cannot be read or used. The message names the file, the broken rule and what would be right.
/// Where the place is known, it also names the line and the column by its header.
using models::DataError;

}  // namespace orbid::orbits
