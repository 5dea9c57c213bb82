#pragma once

#include <cstddef>
#include <filesystem>
#include <functional>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "apps/job/job.hpp"
#include "apps/results/result_file.hpp"
#include "orbits/records/series.hpp"

namespace orbid::apps {

/// The path is not an output folder of this program, or lacks what is requested. The message names both.
class StoredRunRefused : public std::runtime_error {
    using std::runtime_error::runtime_error;
};

/// The files of an output folder that exist, each read once; keys in the order of the files.
///
/// Only `job` always exists: it is stored before the first result. The functions below read large files when needed.
struct StoredRun {
    using Json = nlohmann::ordered_json;

    std::filesystem::path folder;
    Json job;                             ///< job.json, orbid-job/1
    std::optional<Json> result;           ///< result.json, orbid-result/1
    std::optional<Json> cycles;           ///< cycles.json, orbid-cycles/1: measured
    std::optional<Json> orbits;           ///< orbits.json, orbid-cycles/1: computed
    std::optional<Json> estimate_orbits;  ///< estimate_orbits.json, as orbits.json: of a job with a "periodic" block
    std::optional<Json> branch;           ///< branch.json, orbid-branches/1
    std::optional<Json> estimate_branch;  ///< estimate_branch.json, likewise: of a job with a "continuation" as well
    std::optional<Json> invariants;       ///< invariants.json
    std::optional<Json> timing;           ///< timing.json
    std::optional<Json> prediction;       ///< prediction.json, orbid-prediction/1: of `orbid predict`
    std::function<bool()> interrupted;    ///< asked while records are read; if it says so, models::Stopped is thrown

    /// "title" of the job; may be empty.
    [[nodiscard]] std::string title() const;
    /// Entries of "data" of the job, also where it is one object instead of a list.
    [[nodiscard]] std::vector<const Json*> experiments() const;
    /// The orbits that belong to the estimate: estimate_orbits.json, or else orbits.json.
    [[nodiscard]] const Json* orbits_of_estimate() const;
    /// The branch that belongs to the estimate: estimate_branch.json, or else branch.json.
    [[nodiscard]] const Json* shown_branch() const;
};

/// Reads job.json and those of the other files that the folder has.
/// @throws StoredRunRefused when the folder or its job.json does not exist; orbits::DataError naming file, line and
///         column of broken JSON, or file, format found and format expected.
[[nodiscard]] StoredRun read_stored_run(const std::filesystem::path& folder);

/// residuals.csv; empty when the folder has none. Empty cells are nan.
/// @throws orbits::DataError naming file, line and column of what cannot be read.
[[nodiscard]] std::vector<ResidualRow> stored_residuals(const StoredRun& run);

/// predictions.csv: the readings of segments that were only predicted. As stored_residuals.
[[nodiscard]] std::vector<ResidualRow> stored_predictions(const StoredRun& run);

/// Draws from the posterior: names of the columns of posterior.csv, and the values.
struct StoredDraws {
    std::vector<std::string> names;            ///< sampled quantities, without chain, draw and minus_log_density
    std::vector<int> chain;                    ///< of every draw, from 1
    std::vector<std::vector<double>> columns;  ///< one per name, as long as `chain`
};

/// posterior.csv; nothing when the folder has none.
/// @throws orbits::DataError as stored_residuals.
[[nodiscard]] std::optional<StoredDraws> stored_draws(const StoredRun& run);

/// The job of the run, with the files that it names.
/// @throws orbits::DataError naming place and rule of each problem: a missing file, a newer version.
[[nodiscard]] Job stored_job(const StoredRun& run);

/// The model of the run, as job.json describes it; data files need no longer exist.
/// @throws orbits::DataError when this program does not know the model (job of a newer version).
[[nodiscard]] ModelJob stored_model(const StoredRun& run);

/// The record of an experiment: series.h5 or series.csv of the folder (series_NAME.h5 with several experiments), or the
/// file that it was read from, with the columns, units and signs of the job.
/// @param experiment  index into experiments().
/// @return nothing when the record was simulated and not stored.
/// @throws orbits::DataError when the file is missing or cannot be read; std::invalid_argument for an experiment that
///         the job does not have.
[[nodiscard]] std::optional<orbits::Series> stored_series(const StoredRun& run, std::size_t experiment);

}  // namespace orbid::apps
