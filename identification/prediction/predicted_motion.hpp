#pragma once

#include <cstddef>
#include <functional>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "identification/prediction/branch_sheets.hpp"
#include "identification/prediction/motion_quantities.hpp"
#include "identification/prediction/parameter_posterior.hpp"
#include "periodic/branches/continuation.hpp"
#include "periodic/solution/orbit_path.hpp"

namespace orbid::identification {

/// Predictions with what is not known of them. Entries of all vectors belong to each other.
struct PredictedQuantities {
    Eigen::VectorXd value;  ///< at the estimate
    Eigen::VectorXd sd;     ///< over the draws that have the motion; without draws that of the delta method
    Eigen::VectorXd
        lower95;  ///< quantiles of these draws; nan for fewer than `fewest_draws`. Without draws value -+ 1.96 sd
    Eigen::VectorXd upper95;
    Eigen::VectorXd delta_sd;  ///< sqrt(j C j^T) with the motion's own derivatives j; nan where they are not known
    std::size_t found = 0;     ///< draws that have the motion
    double stable = 0.0;       ///< share of these in which it is stable; nan without draws
};

/// Fewer draws have no quantiles of 2.5 %.
constexpr std::size_t fewest_draws = 40;

/// A periodic orbit at the estimate and over the draws.
struct PredictedOrbit {
    periodic::PeriodicOrbit orbit;  ///< status: why there is none
    MotionQuantities layout;
    PredictedQuantities quantities;
};

/// A place of a branch and where it is over the draws.
struct PredictedMark {
    BranchMark mark;
    PredictedQuantities parameter;  ///< one entry
};

/// A branch at the estimate and over the draws.
struct PredictedBranch {
    periodic::OrbitStatus start = periodic::OrbitStatus::no_progress;  ///< converged, or why there is no branch
    periodic::Branch branch;
    Eigen::VectorXd near;  ///< the state at its start
    MotionQuantities layout;
    std::vector<PredictedQuantities> points;  ///< one per point of the branch, at its value of the parameter
    std::vector<int> sheets;                  ///< of the points
    std::vector<PredictedMark> marks;
    std::size_t followed = 0;         ///< draws whose branch was followed; the others lost the orbit at the start
    std::vector<BranchSheets> draws;  ///< their branches, for single values of the parameter
};

/// What draws take, and who looks on.
struct PredictionRun {
    std::function<void(std::size_t done)> progress{};  ///< draws done; called from several threads
    std::function<bool()> interrupted{};               ///< asked between draws; then models::Stopped is thrown
};

/// Predicts the orbit that `start` leads to at the posterior's values, at `to`.
///
/// The orbit is followed from there to `to`, and from the estimate to every draw, by orbit_along(): a draw in which it
/// meets a fold has lost it. The delta method takes the orbit's own derivatives.
/// @param to  values of all parameters; estimated ones that differ from the estimate are held there
[[nodiscard]] PredictedOrbit predict_orbit(const models::System& system, const ParameterPosterior& posterior,
                                           const ParameterDraws& draws, const periodic::StartingSolution& start,
                                           const Eigen::VectorXd& to, std::vector<periodic::OrbitReading> readings,
                                           const PredictionRun& run = {});

/// Predicts a branch.
///
/// It is followed at the estimate, and anew for every draw from the start's orbit there. Bands at a value of the
/// parameter are those of the draws on the same sheet (BranchSheets): beyond the fold of a draw there is no orbit, and
/// it is not counted. Near folds this is right, and the delta method is not: its derivatives grow without bound there.
/// @param draws    the followed parameter keeps the posterior's value in all of them
/// @param options  of the branch at the estimate; bifurcations are located, no other branch is switched to
[[nodiscard]] PredictedBranch predict_branch(const models::System& system, const ParameterPosterior& posterior,
                                             const ParameterDraws& draws, const periodic::StartingSolution& start,
                                             periodic::ContinuationOptions options,
                                             std::vector<periodic::OrbitReading> readings,
                                             const PredictionRun& run = {});

/// The quantities of a predicted branch at one value of the parameter on a sheet.
/// @return `value` is nan where the branch at the estimate has no orbit there, and empty where no draw has one either.
[[nodiscard]] PredictedQuantities quantities_at(const PredictedBranch& predicted, const BranchSheets& estimate,
                                                int sheet, double parameter);

/// The same by the delta method: its sds between the two points of the branch next to that value on the sheet.
[[nodiscard]] PredictedQuantities delta_at(const PredictedBranch& predicted, int sheet, double parameter,
                                           const Eigen::VectorXd& value);

/// The sheets of the branch at the estimate.
[[nodiscard]] BranchSheets sheets_of(const PredictedBranch& predicted, double start);

/// Value, sd and quantiles from draws, the columns of `drawn`; nan entries are left out one by one.
[[nodiscard]] PredictedQuantities summarised(const Eigen::VectorXd& value, const Eigen::MatrixXd& drawn,
                                             const Eigen::VectorXd& delta_sd);
/// Value and sd with normal intervals.
[[nodiscard]] PredictedQuantities by_delta_method(const Eigen::VectorXd& value, const Eigen::VectorXd& delta_sd);

}  // namespace orbid::identification
