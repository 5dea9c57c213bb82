#pragma once

#include <stdexcept>

#pragma GCC visibility push(default)

namespace orbid::models {

/// Data of the user that cannot be used: a file, a record, an input signal, or a question that these data cannot
/// answer. The message names the rule that is broken and, where it is known, the place. A wrong call, which no data
/// excuse, throws std::invalid_argument instead.
class DataError : public std::runtime_error {
public:
    using std::runtime_error::runtime_error;
};

}  // namespace orbid::models

#pragma GCC visibility pop
