#pragma once

#include <string>
#include <vector>

#include "apps/job/job.hpp"
#include "apps/stages/searched_section.hpp"

namespace orbid::apps {

/// What a record tells in which no cycle was found: how many points its section has and a search needs, how near it
/// comes back to itself, whether the record repeats as a whole, and which residuals need no cycles. In sentences.
[[nodiscard]] std::vector<std::string> without_cycles(const Job& job, const SearchedSection& section);

/// What is said where samples have not even a section.
[[nodiscard]] std::string without_section(const orbits::Series& samples);

}  // namespace orbid::apps
