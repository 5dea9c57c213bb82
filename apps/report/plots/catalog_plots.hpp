#pragma once

#include <string>
#include <string_view>

#include "apps/drawing/plot_style.hpp"
#include "apps/stored_run/stored_run.hpp"

/// The plots of the catalogue. Each has two functions: whether a run holds the data for it (cheap: looks at what is
/// read already and at which files there are), and the picture; the second may be called where the first says true, and
/// throws orbits::DataError when a file cannot be read.
namespace orbid::apps::catalog {

/// Colour of what is estimated.
inline constexpr std::string_view blue = "#0072b2";

[[nodiscard]] bool has_section(const StoredRun& run);
[[nodiscard]] std::string section(const StoredRun& run, const PlotStyle& style);
[[nodiscard]] bool has_cycles(const StoredRun& run);
[[nodiscard]] std::string cycles(const StoredRun& run, const PlotStyle& style);
[[nodiscard]] bool has_multipliers(const StoredRun& run);
[[nodiscard]] std::string multipliers(const StoredRun& run, const PlotStyle& style);
[[nodiscard]] bool has_branch(const StoredRun& run);
[[nodiscard]] std::string branch(const StoredRun& run, const PlotStyle& style);

[[nodiscard]] bool has_parameters(const StoredRun& run);
[[nodiscard]] std::string parameters(const StoredRun& run, const PlotStyle& style);
[[nodiscard]] bool has_convergence(const StoredRun& run);
[[nodiscard]] std::string convergence(const StoredRun& run, const PlotStyle& style);
[[nodiscard]] bool has_correlation(const StoredRun& run);
[[nodiscard]] std::string correlation(const StoredRun& run, const PlotStyle& style);
[[nodiscard]] bool has_singular_values(const StoredRun& run);
[[nodiscard]] std::string singular_values(const StoredRun& run, const PlotStyle& style);
[[nodiscard]] bool has_evidence(const StoredRun& run);
[[nodiscard]] std::string evidence(const StoredRun& run, const PlotStyle& style);

[[nodiscard]] bool has_profiles(const StoredRun& run);
[[nodiscard]] std::string profiles(const StoredRun& run, const PlotStyle& style);
[[nodiscard]] bool has_marginals(const StoredRun& run);
[[nodiscard]] std::string marginals(const StoredRun& run, const PlotStyle& style);
[[nodiscard]] bool has_posterior(const StoredRun& run);
[[nodiscard]] std::string posterior(const StoredRun& run, const PlotStyle& style);

[[nodiscard]] bool has_residuals(const StoredRun& run);
[[nodiscard]] std::string residuals(const StoredRun& run, const PlotStyle& style);
[[nodiscard]] std::string normal_quantiles(const StoredRun& run, const PlotStyle& style);
[[nodiscard]] bool has_prediction(const StoredRun& run);
[[nodiscard]] std::string prediction(const StoredRun& run, const PlotStyle& style);
[[nodiscard]] bool has_waveform(const StoredRun& run);
[[nodiscard]] std::string waveform(const StoredRun& run, const PlotStyle& style);

/// A number of result.json; nan where it is null or absent.
[[nodiscard]] double number(const StoredRun::Json& object, const char* key);
/// A name for people: greek letters, "k2_over_m" as "k2/m", "x@run1" kept.
[[nodiscard]] std::string quantity_name(const std::string& name);

}  // namespace orbid::apps::catalog
