#pragma once

#include <filesystem>
#include <string>

#include <Eigen/Core>

#include "apps/job/job.hpp"
#include "apps/stored_run/stored_run.hpp"

namespace orbid::apps {

/// What is needed to predict a further record with the estimate of a stored run.
struct PredictionJob {
    Job stored;                  ///< parameters fixed at their estimates: job.json of the prediction
    Job derived;                 ///< the same with the estimated parameters free, at their estimates: for derivatives
    Eigen::MatrixXd covariance;  ///< of the free parameters of `derived`, in order; empty: unknown
    bool known_errors = false;   ///< the run estimated or knew the sds of the readings
};

/// Makes the job of a prediction from that of a run. It has one experiment, the record in `data`, with columns, sensor,
/// inputs and observed coordinates of the run's experiment. Errors of the readings are at their estimates. Initial
/// states are free, except those fixed in the run, with the starts and bounds that the run gives them.
///
/// @param data        a table or HDF5 file in the layout of the run's data; or a JSON file that holds one "data" object
///                    of a job for another layout (what it leaves out is taken from the run's experiment).
/// @param inputs      table of the measured inputs during the record, where those of the run have a table of their own;
///                    empty: `data` has them, or says where they are.
/// @param experiment  name of the corresponding experiment of the run; empty: the only one.
/// @throws StoredRunRefused when the run has no estimate, the experiment does not exist, several exist and none is
///         named, or the inputs are missing or not wanted; orbits::DataError when a file is missing or the layout does
///         not fit.
[[nodiscard]] PredictionJob prediction_job(const StoredRun& run, const std::filesystem::path& data,
                                           const std::filesystem::path& inputs, const std::string& experiment);

}  // namespace orbid::apps
