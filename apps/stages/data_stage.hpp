#pragma once

#include <cstddef>
#include <filesystem>
#include <optional>
#include <vector>

#include "apps/stages/input_record.hpp"
#include "apps/stages/workspace.hpp"
#include "orbits/records/series.hpp"

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

/// The record of an experiment that the job reads from a file.
/// @throws orbits::DataError when the file cannot be read or is no record of the job's kind and model.
[[nodiscard]] orbits::Series recorded_series(const Job& job, std::size_t experiment);

/// The record of an experiment that was simulated and stored in `folder`; nothing when it was not stored. Its
/// fingerprint is not looked at: job.json of the same folder is the job it belongs to.
/// @throws orbits::DataError when the file cannot be read.
[[nodiscard]] std::optional<orbits::Series> simulated_series(const Job& job, std::size_t experiment,
                                                             const std::filesystem::path& folder);

}  // namespace orbid::apps
