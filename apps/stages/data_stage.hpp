#pragma once

#include <cstddef>
#include <filesystem>
#include <memory>
#include <optional>
#include <vector>

#include "apps/results/result_file.hpp"
#include "apps/stages/input_record.hpp"
#include "apps/stages/workspace.hpp"
#include "orbits/records/series.hpp"
#include "orbits/records/series_stream.hpp"

namespace orbid::apps {

/// The record of one experiment and the events of its simulation.
struct Experiment {
    orbits::Series series;
    std::vector<Capture> captured;
    Inputs inputs;  ///< one per segment of the series; empty when the model reads none
    /// Of a record that is read piece by piece; `series` has no segments then. Null: all is in the series.
    std::shared_ptr<const orbits::SeriesStream> stream = {};

    [[nodiscard]] std::size_t points() const { return stream ? stream->size() : series.size(); }
    [[nodiscard]] std::size_t segments() const { return stream ? stream->lengths().size() : series.segments.size(); }
};

/// Reads or simulates the records of all experiments of the job, in order. Simulated ones are stored as series.h5 (or
/// .csv), series_NAME.h5 when there are several, and reused while their fingerprint fits.
///
/// @throws orbits::DataError when a file cannot be read or used, StaleFile as reusable() does.
[[nodiscard]] std::vector<Experiment> load_data(const Workspace& work);

/// The record of a simulated experiment stored in `folder`; nothing if not stored. Its fingerprint is not checked: it
/// belongs to job.json in the same folder.
/// @throws orbits::DataError when the file cannot be read.
[[nodiscard]] std::optional<orbits::Series> simulated_series(const Job& job, std::size_t experiment,
                                                             const std::filesystem::path& folder,
                                                             const std::function<bool()>& interrupted = {});

}  // namespace orbid::apps
