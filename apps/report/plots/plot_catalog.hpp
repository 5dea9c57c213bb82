#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "apps/drawing/plot_style.hpp"
#include "apps/stored_run/stored_run.hpp"

namespace orbid::apps {

/// One plot that a stored run has the data for.
struct AvailablePlot {
    std::string name;         ///< as `orbid plot DIR NAME` takes it
    std::string description;  ///< one sentence: what is shown, and what to look for
};

/// The plots for which the run holds data, in the order of `orbid plot DIR`.
[[nodiscard]] std::vector<AvailablePlot> available_plots(const StoredRun& run);

/// Names of all plots of the catalogue, of any run.
[[nodiscard]] std::vector<std::string> plot_names();

/// A plot as SVG 1.1 text: self-contained, without scripts, ids and style sheets, so that several may stand in one page
/// of HTML. The same run and style give the same bytes.
/// @throws std::invalid_argument when `name` is none of available_plots(run) or the style is out of its ranges;
///         orbits::DataError when a file that it needs cannot be read.
[[nodiscard]] std::string plot_svg(const StoredRun& run, std::string_view name, const PlotStyle& style = {});

}  // namespace orbid::apps
