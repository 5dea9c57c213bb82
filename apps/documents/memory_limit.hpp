#pragma once

#include <string>

namespace orbid::apps {

/// What to say after std::bad_alloc: what the process holds, and the limit that stands in its way: that of its address
/// space or data (RLIMIT_AS, RLIMIT_DATA: `ulimit -v`, batch systems), else what the machine has left.
/// @return "out of memory: 231 MB are in use, the limit is 256 MB (ulimit -v)"
[[nodiscard]] std::string out_of_memory_text();

}  // namespace orbid::apps
