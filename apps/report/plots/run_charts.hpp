#pragma once

#include <optional>

#include "apps/drawing/chart.hpp"
#include "apps/report/plots/json_member.hpp"
#include "apps/stored_run/stored_run.hpp"

/// The pictures of a stored run as charts. One without views where the run has nothing for it. All throw
/// orbits::DataError when a file that they need cannot be read.
namespace orbid::apps {

/// The points of the section under its periodic points.
[[nodiscard]] Chart section_chart(const StoredRun& run);
/// The periodic points alone: measured ones, else those of the model.
[[nodiscard]] Chart cycle_chart(const StoredRun& run);
/// Largest multipliers by period, those of one period side by side by size; measured and of the model.
[[nodiscard]] Chart multiplier_chart(const StoredRun& run);
/// Branches, one view per coordinate: the one that the job plots (or the time) first.
[[nodiscard]] Chart branch_chart(const StoredRun& run);

/// Whether a parameter or derived quantity has a known value.
[[nodiscard]] bool has_references(const StoredRun& run);
/// Estimates with their intervals, from the known values in sds; without any, intervals in percent of the estimate.
[[nodiscard]] Chart parameter_chart(const StoredRun& run);
/// The objective above its last value, step by step; how far each stage left the parameters from the result.
[[nodiscard]] Chart convergence_chart(const StoredRun& run);
/// What each stage said of each parameter.
[[nodiscard]] Chart stage_chart(const StoredRun& run);
[[nodiscard]] Chart correlation_chart(const StoredRun& run);
[[nodiscard]] Chart singular_value_chart(const StoredRun& run);
/// Logarithms of the Bayes factors against other models.
[[nodiscard]] Chart evidence_chart(const StoredRun& run);

/// Signed roots of twice the rise of the objective along each parameter.
[[nodiscard]] Chart profile_chart(const StoredRun& run);
/// Densities of the quantities: nested Laplace approximations as lines, draws as columns, normal ones dashed.
[[nodiscard]] Chart marginal_chart(const StoredRun& run, const std::optional<StoredDraws>& draws);
/// Draws of the parameters in pairs.
[[nodiscard]] Chart posterior_chart(const StoredRun& run, const std::optional<StoredDraws>& draws);

/// Modulus of the largest multiplier of a cycle; nan where it is not known.
[[nodiscard]] double largest_multiplier(const detail::Json& cycle);
/// Its sd over itself, of a measured one; nan where it is not known.
[[nodiscard]] double largest_multiplier_sd(const detail::Json& cycle);

}  // namespace orbid::apps
