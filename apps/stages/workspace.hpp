#pragma once

#include <filesystem>
#include <functional>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include <nlohmann/json.hpp>

#include "apps/documents/fingerprint.hpp"
#include "apps/job/job.hpp"
#include "apps/results/output_folder.hpp"
#include "apps/stages/interruption.hpp"
#include "apps/stages/progress.hpp"
#include "apps/stages/run_options.hpp"
#include "apps/stages/run_stop.hpp"

namespace orbid::apps {

/// A file of an earlier stage, found by a single-stage command, belongs to another job.
class StaleFile : public std::runtime_error {
    using std::runtime_error::runtime_error;
};

/// What the stages of one run share.
struct Workspace {
    const Job& job;
    const RunOptions& options;
    const nlohmann::json& document;  ///< the complete job, as job.json holds it
    Progress& progress;
    const Interruption& interruption;
    OutputFolder& folder;
    RunStop& stop;

    [[nodiscard]] std::filesystem::path file(const std::string& name) const { return folder.file(name); }
    /// For options of computations that ask whether to stop.
    [[nodiscard]] std::function<bool()> asking() const {
        return [&stop = stop] { return stop.now(); };
    }
    [[nodiscard]] const models::System& system() const { return *job.model.system; }
};

/// Whether the file of an earlier stage may be used: compares its fingerprint (as text; empty: none) with the job's.
///
/// @return true when they agree; false when the stage must run again.
/// @throws StaleFile naming file and key when they differ and only a later stage was requested.
[[nodiscard]] bool reusable(const Workspace& work, Stage stage, const std::filesystem::path& file,
                            const std::string& stored_fingerprint, const Fingerprint& wanted);

/// What the file of a stage depends on: the program's version and every value below the given places of the complete
/// job, in the order given. A place that the job lacks counts as absent; the job holds hashes of its data files.
///
/// @param job     the complete job, as job.json holds it.
/// @param places  JSON Pointers: "/model", "/data".
[[nodiscard]] Fingerprint stage_fingerprint(const nlohmann::json& job, const std::vector<std::string_view>& places);

}  // namespace orbid::apps
