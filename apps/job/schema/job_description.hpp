#pragma once

#include "apps/documents/description.hpp"

namespace orbid::apps {

/// What a job may hold: every key with its kinds of value, range, default and one sentence. The reader of jobs, `orbid
/// schema` and docs/job_reference.md all follow it.
[[nodiscard]] const ValueDescription& job_description();

namespace describe {

// The blocks of a job.
[[nodiscard]] ValueDescription model_block();
[[nodiscard]] ValueDescription section_block();
[[nodiscard]] ValueDescription data_block();
[[nodiscard]] ValueDescription orbits_block();
[[nodiscard]] ValueDescription periodic_block();
[[nodiscard]] ValueDescription estimate_block();

// Parts of several blocks.
[[nodiscard]] ValueDescription prior();
[[nodiscard]] ValueDescription residual();
/// [lower, upper], null = none.
[[nodiscard]] ValueDescription bounds();
/// A number of this form, "estimate", or { "estimate": { "start", "prior" } }.
[[nodiscard]] ValueDescription number_or_estimate(const ValueDescription& number);
/// One number per coordinate.
[[nodiscard]] ValueDescription state();
[[nodiscard]] ValueDescription matrix();
/// Different names.
[[nodiscard]] ValueDescription names(std::size_t fewest = 0);
/// Different numbers of periods.
[[nodiscard]] ValueDescription periods();
[[nodiscard]] ValueDescription file_name();
/// Of a column in a table.
[[nodiscard]] ValueDescription header();
[[nodiscard]] ValueDescription sha256();
[[nodiscard]] ValueDescription seed();
/// A name that the user gives.
[[nodiscard]] ValueDescription name();

/// Cycles and measured orbits: longer ones cannot be told from chance recurrences in any series of usable length; also
/// the rule of CycleSearchOptions::periods.
inline constexpr double longest_period = 64;
/// Largest whole number up to which every whole number is a double.
inline constexpr double largest_exact = 9007199254740992.0;

}  // namespace describe

}  // namespace orbid::apps
