#pragma once

#include <cstddef>
#include <functional>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "apps/results/followed_branch.hpp"
#include "apps/stored_run/motion_question.hpp"
#include "identification/prediction/predicted_motion.hpp"

namespace orbid::apps {

/// One measure of a measured motion beside its prediction.
struct ComparedMeasure {
    std::string motion;  ///< "U = 14.9"
    double parameter = 0.0;
    std::string name;  ///< "h.half_range"
    std::string unit;
    double observed = 0.0;
    double predicted = 0.0;  ///< nan: the branch at the estimate has no orbit there
    double sd = 0.0;
    double lower95 = 0.0;
    double upper95 = 0.0;
    double error_sd =
        0.0;  ///< of the errors of such a measure: known of the table, or as the run estimated; nan: unknown
    int sheet = 0;
    std::size_t found = 0;
    double stable = 0.0;     ///< share of the draws in which the motion is stable
    bool is_stable = false;  ///< at the estimate

    /// Whether the measured value lies in the band of the prediction.
    [[nodiscard]] bool inside() const { return observed >= lower95 && observed <= upper95; }
    /// Whether it lies in that of prediction and error together, 1.96 of the root of the sum of their squares.
    [[nodiscard]] bool inside_with_errors() const;
    [[nodiscard]] double relative_error() const { return (predicted - observed) / observed; }
};

/// An orbit of the question at one set of parameters.
struct AskedOrbit {
    std::size_t start = 0;                           ///< which of the starts
    std::vector<std::pair<std::string, double>> at;  ///< the parameters that the question sets
    identification::PredictedOrbit predicted;
};

struct MotionPrediction {
    std::size_t draws = 0;                ///< 0: the delta method
    bool from_sample = false;             ///< of the posterior; else normal ones in the scales of the estimate
    std::size_t outside = 0;              ///< normal draws beyond bounds, which were drawn anew
    std::vector<std::string> parameters;  ///< that vary
    std::vector<AskedOrbit> orbits;
    bool has_branch = false;
    identification::PredictedBranch branch;
    std::string parameter;  ///< of the branch
    std::string unit;
    FollowedBranches followed;  ///< the branch at the estimate with the measured motions, for pictures
    std::vector<ComparedMeasure> compared;
    std::vector<std::string> quantities;  ///< names of all that is predicted of a motion, but the points
    std::vector<std::string> units;
    std::vector<std::string> remarks;
};

/// Answers a question.
/// @param progress  called with the draws done and their number, for each orbit and branch from 0 on; from several
///                  threads
/// @throws orbits::DataError on a table that cannot be read, StoredRunRefused where no draws can be made.
[[nodiscard]] MotionPrediction predict_motions(
    const StoredRun& run, const MotionQuestion& question,
    const std::function<void(const std::string& what, std::size_t done, std::size_t total)>& progress = {});

}  // namespace orbid::apps
