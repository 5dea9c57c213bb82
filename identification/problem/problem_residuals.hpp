#pragma once

#include <cstddef>
#include <memory>
#include <vector>

#include "estimator/interface/residual.hpp"
#include "identification/problem/estimate_setup.hpp"
#include "identification/problem/identification_problem.hpp"
#include "identification/problem/problem_branch.hpp"
#include "identification/problem/problem_waveform.hpp"
#include "orbits/cycle_residuals/cycle_residual.hpp"
#include "orbits/series_residuals/prediction_residual.hpp"
#include "orbits/series_residuals/series_residual.hpp"
#include "orbits/series_residuals/shooting_residual.hpp"

namespace orbid::identification {

/// The residuals of a problem, each with its own type, from which results are read back.
struct ProblemResiduals {
    std::unique_ptr<orbits::CycleResidual> cycles;
    std::vector<std::unique_ptr<orbits::SeriesResidual>> series;  ///< by single shooting
    std::vector<std::size_t> experiments;                         ///< of `series`: index of the experiment
    std::vector<std::unique_ptr<orbits::ShootingResidual>> shooting;
    std::vector<std::size_t> shooting_experiments;  ///< of `shooting`
    std::vector<std::unique_ptr<orbits::PredictionResidual>> prediction;
    ProblemWaveform waveform;
    std::unique_ptr<periodic::BranchResidual> branch;

    /// Cycles, then series by single and by multiple shooting, then waveform and branch; predictions last.
    [[nodiscard]] std::vector<const estimator::Residual*> all() const;
    /// Place of the first one of `shooting` in all().
    [[nodiscard]] std::size_t first_shooting() const { return (cycles ? 1 : 0) + series.size(); }
    /// A copy of each, in the same order.
    [[nodiscard]] std::vector<std::unique_ptr<estimator::Residual>> copies() const;
};

/// How the errors of a coordinate are distributed.
[[nodiscard]] orbits::ErrorForm error_form(const RecordErrors& error);

/// Labels of the fitted segments of every experiment that a series residual uses; empty for the others.
/// @throws orbits::DataError naming a missing segment.
[[nodiscard]] std::vector<std::vector<std::string>> fitted_labels(const IdentificationProblem& problem);

/// An experiment from one initial state per segment.
/// @throws orbits::DataError when the data cannot serve it, naming the experiment.
[[nodiscard]] std::unique_ptr<orbits::SeriesResidual> single_shooting(const IdentificationProblem& problem,
                                                                      std::size_t experiment,
                                                                      const EstimateSetup& setup);

/// The model with each of these signals; as it is without any.
[[nodiscard]] std::vector<std::shared_ptr<const models::System>> systems_with(
    const std::shared_ptr<const models::System>& system, const Inputs& inputs);

/// Adds a residual by single shooting per experiment of a series without nodes, and fills in starts of initial values
/// from the data where the problem gives none.
/// @throws orbits::DataError when the data cannot serve it, naming the experiment.
void add_series(const IdentificationProblem& problem, EstimateSetup& setup, ProblemResiduals& residuals);

/// A series with fewer readings than unknowns cannot be used. Parameters with a prior need no readings, and cycles give
/// more data than is counted here.
/// @throws orbits::DataError naming the experiments and both numbers.
void check_enough_readings(const IdentificationProblem& problem, const EstimateSetup& setup,
                           const ProblemResiduals& residuals);

}  // namespace orbid::identification
