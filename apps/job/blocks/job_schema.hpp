#pragma once

#include "apps/documents/schema.hpp"

namespace orbid::apps {

/// What a job may contain: every key with its kinds of value, range, default and one sentence. The job reader, `orbid
/// schema` and docs/job_reference.md all follow it.
[[nodiscard]] const ValueSchema& job_description();

namespace describe {

// The blocks of a job.
[[nodiscard]] ValueSchema section_block();
[[nodiscard]] ValueSchema data_block();

// Parts of several blocks.
/// [lower, upper], null = none.
[[nodiscard]] ValueSchema bounds();
/// One number per coordinate.
[[nodiscard]] ValueSchema state();
[[nodiscard]] ValueSchema matrix();
/// Different names.
[[nodiscard]] ValueSchema names(std::size_t fewest = 0);
/// Different numbers of periods.
[[nodiscard]] ValueSchema periods();
[[nodiscard]] ValueSchema file_name();
/// Of a column in a table.
[[nodiscard]] ValueSchema header();
[[nodiscard]] ValueSchema sha256();
[[nodiscard]] ValueSchema seed();
/// A name that the user gives.
[[nodiscard]] ValueSchema name();

/// Cycles and measured orbits: longer ones cannot be distinguished from chance recurrences in any series of usable
/// length. CycleSearchOptions::periods has the same rule.
inline constexpr double longest_period = 64;
/// A thousand periods of a chaotic model are beyond any orbit that can be solved for: multipliers exceed 1e300.
inline constexpr double longest_computed_period = 1000;
/// More points than any memory holds (2^40 points of two doubles are 16 TB): a typing error.
inline constexpr double most_simulated_points = 1099511627776.0;
/// Largest whole number up to which every whole number is a double.
inline constexpr double largest_exact = 9007199254740992.0;

}  // namespace describe

}  // namespace orbid::apps
