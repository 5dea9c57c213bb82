#pragma once

#include <vector>

#include "apps/input_record.hpp"
#include "apps/workspace.hpp"
#include "orbits/series.hpp"

namespace orbid::apps {

/// The record of one experiment and what happened while it was simulated.
struct Experiment {
    orbits::Series series;
    std::vector<Capture> captured;
    Inputs inputs;  ///< one per segment of the series; empty when the model reads none
};

/// Reads or simulates the records of all experiments of the job, in their order; simulated ones are stored as
/// series.h5 (or .csv), series_NAME.h5 when there are several, and taken from there while their fingerprint fits.
///
/// @throws orbits::DataError when a file cannot be read or used, StaleFile as reusable() does.
[[nodiscard]] std::vector<Experiment> load_data(const Workspace& work);

}  // namespace orbid::apps
