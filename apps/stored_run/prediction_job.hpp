#pragma once

#include <filesystem>
#include <string>

#include <Eigen/Core>

#include "apps/job/job.hpp"
#include "apps/stored_run/stored_run.hpp"

namespace orbid::apps {

/// What predicting a further record with the estimate of a stored run needs.
struct PredictionJob {
    Job stored;   ///< parameters held at their estimates, none of them free: what job.json of the prediction says
    Job derived;  ///< the same with the estimated parameters free, at their estimates: for derivatives
    Eigen::MatrixXd covariance;  ///< of the free parameters of `derived`, in their order; empty: not known
    bool known_errors = false;   ///< the run has estimated or known sds of the readings
};

/// Makes the job of a prediction from the one of a run: one experiment, the record in `data`, with columns, sensor,
/// inputs and observed coordinates of the run's experiment; errors of the readings at their estimates; initial states
/// free, but for those that the run held at a value.
///
/// @param data        a table or HDF5 file in the layout of the run's data; or a JSON file that holds one "data" object
///                    of a job for another layout (what it leaves out is taken from the run's experiment).
/// @param experiment  name of the run's experiment that the record is like; empty: the only one.
/// @throws StoredRunRefused when the run has no estimate, or the experiment is not there, or several are and none is
///         named; orbits::DataError when a file is missing or the layout does not fit.
[[nodiscard]] PredictionJob prediction_job(const StoredRun& run, const std::filesystem::path& data,
                                           const std::string& experiment);

}  // namespace orbid::apps
