#pragma once

#include <string>

#include "apps/results/output_folder.hpp"
#include "apps/stored_run/stored_run.hpp"

namespace orbid::apps {

/// One self-contained page of HTML about a stored run: style, still pictures (SVG), tables, and scripts that make live
/// charts of the pictures and sort the tables. It asks for nothing from a network, reads without scripts, prints, and
/// follows the reader's choice of light or dark. The same files give the same bytes.
///
/// @throws orbits::DataError when a file of the folder that it needs cannot be read.
[[nodiscard]] std::string report_html(const StoredRun& run);

}  // namespace orbid::apps
