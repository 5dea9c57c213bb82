#pragma once

#include <stdexcept>
#include <utility>

#include <fmt/format.h>

#include "orbits/records/data_error.hpp"

namespace orbid::orbits {

/// Refuses a wrong call. The message names the value and the rule; it is made only where it is needed.
/// @throws std::invalid_argument
template <class... Values>
void refuse_if(bool wrong, fmt::format_string<Values...> message, Values&&... values) {
    if (wrong) throw std::invalid_argument(fmt::format(message, std::forward<Values>(values)...));
}

/// Refuses a record, or a question that it cannot answer; likewise.
/// @throws DataError
template <class... Values>
void refuse_record_if(bool wrong, fmt::format_string<Values...> message, Values&&... values) {
    if (wrong) throw DataError(fmt::format(message, std::forward<Values>(values)...));
}

}  // namespace orbid::orbits
