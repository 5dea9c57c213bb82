#pragma once

#include <string>
#include <utility>
#include <vector>

#pragma GCC visibility push(default)

namespace orbid::apps {

/// What wrote a job.json, for the record: { "orbid", "0.1.0" }, ... . Not part of the job.
using Versions = std::vector<std::pair<std::string, std::string>>;

/// Version of the program, "0.1.0".
[[nodiscard]] std::string program_version();

/// Versions of the program, its compiler, its instruction level, and the libraries whose versions can change a number.
[[nodiscard]] Versions versions();

}  // namespace orbid::apps

#pragma GCC visibility pop
