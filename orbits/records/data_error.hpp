#pragma once

#include <stdexcept>
#include <string>

#pragma GCC visibility push(default)

namespace orbid::orbits {

/// Recorded data that cannot be read or used. The message names the file, the broken rule and what would be right.
/// Where the place is known, it also names the line and the column by its header.
class DataError : public std::runtime_error {
public:
    using std::runtime_error::runtime_error;
};

}  // namespace orbid::orbits

#pragma GCC visibility pop
