#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include "apps/job/job.hpp"
#include "apps/stored_run/stored_run.hpp"
#include "identification/prediction/parameter_posterior.hpp"

namespace orbid::apps {

/// What is asked of periodic motions after an estimate.
struct MotionQuestion {
    Job job;  ///< the run's model at the estimate, "periodic", and measured motions as a residual of type branch
    identification::ParameterPosterior posterior;
    std::vector<Eigen::VectorXd> at;  ///< values of all parameters at which the starts are predicted; at least one
    bool asks_orbits = false;         ///< "at" is given: beside a branch single orbits, too
    std::optional<bool> stable;       ///< the measured motions are all stable, or all unstable; nothing: not said
    bool draws = true;                ///< false: the delta method alone
    std::size_t count = 200;          ///< draws
    std::uint64_t seed = 1;
    std::vector<std::string> remarks;  ///< on the estimate
};

/// Whether a file is a question on periodic motions: JSON with "periodic" or "measured" in it. For a run whose data are
/// a branch alone, a table is one, too: measured motions.
[[nodiscard]] bool is_motion_question(const StoredRun& run, const std::filesystem::path& file);

/// Reads a question. What it leaves out of "measured" comes from the run's residual of type branch: parameter, columns,
/// readings, range, and the orbit, from the fitted branch. Without "periodic" the branch of the measured motions is
/// followed.
/// @param experiment  whose values hold of parameters that are estimated per experiment; empty: none
/// @throws StoredRunRefused on a run without an estimate or a question that it cannot answer, naming place and rule;
///         orbits::DataError on a file that cannot be read.
[[nodiscard]] MotionQuestion motion_question(const StoredRun& run, const std::filesystem::path& file,
                                             const std::string& experiment);

}  // namespace orbid::apps
