#pragma once

#include <stdexcept>
#include <string>

#pragma GCC visibility push(default)

namespace orbid::orbits {

/// Recorded data that cannot be read or used. The message names the file, where the place is known the line and the
/// column by its header, the rule that is broken and what would be right.
class DataError : public std::runtime_error {
public:
    using std::runtime_error::runtime_error;
};

}  // namespace orbid::orbits

#pragma GCC visibility pop
