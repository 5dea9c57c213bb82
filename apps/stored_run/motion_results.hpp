#pragma once

#include <string>

#include "apps/results/branch_file.hpp"
#include "apps/stored_run/motion_prediction.hpp"

namespace orbid::apps {

/// Content of prediction.json, format orbid-prediction/1, kind "periodic": `posterior` (method, draws and where they
/// are from, the parameters that vary), `orbits`, `branch` (`points` in the order of branch.json, `marks`: folds, other
/// bifurcations, Hopf points), `measured`. Of everything predicted `value`, `sd`, `interval95`, `delta_sd`; how many
/// draws have it: `found`; in which share of them it is stable: `stable`.
[[nodiscard]] std::string motion_prediction_text(const MotionPrediction& prediction);

/// branch.csv with sd and 95 % interval of every measure, the sheet, the draws that have the orbit, and the share in
/// which it is stable, in further columns.
[[nodiscard]] std::string predicted_branch_csv(const CycleFileHead& head, const models::Parameter& parameter,
                                               const MotionPrediction& prediction);

/// Tables for standard output.
[[nodiscard]] std::string motion_summary(const MotionPrediction& prediction, const std::string& heading);

}  // namespace orbid::apps
