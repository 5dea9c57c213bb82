#pragma once

#include <cstddef>
#include <memory>
#include <vector>

#include "apps/estimation/estimate_setup.hpp"
#include "apps/estimation/estimate_waveform.hpp"
#include "apps/job/job.hpp"
#include "apps/stages/data_stage.hpp"
#include "estimator/interface/residual.hpp"
#include "orbits/cycle_residuals/cycle_residual.hpp"
#include "orbits/series_residuals/prediction_residual.hpp"
#include "orbits/series_residuals/series_residual.hpp"
#include "orbits/series_residuals/shooting_residual.hpp"

namespace orbid::apps {

/// The residuals of a job, each with its own type, from which results are read back.
struct JobResiduals {
    std::unique_ptr<orbits::CycleResidual> cycles;
    std::vector<std::unique_ptr<orbits::SeriesResidual>> series;  ///< by single shooting
    std::vector<std::size_t> experiments;                         ///< of `series`: index into Job::data
    std::vector<std::unique_ptr<orbits::ShootingResidual>> shooting;
    std::vector<std::size_t> shooting_experiments;  ///< of `shooting`
    std::vector<std::unique_ptr<orbits::PredictionResidual>> prediction;
    JobWaveform waveform;

    /// Cycles, then series by single and by multiple shooting, then the waveform; predictions last.
    [[nodiscard]] std::vector<estimator::Residual*> all() const;
};

/// How the errors of a coordinate are distributed.
[[nodiscard]] orbits::ErrorForm error_form(const ErrorJob& error);

/// Labels of the fitted segments of every experiment that a series residual uses; empty for the others.
/// @throws orbits::DataError naming a missing segment.
[[nodiscard]] std::vector<std::vector<std::string>> fitted_labels(const Job& job, const std::vector<Experiment>& data);

/// How the measured cycles are weighted, how their errors are distributed and how their points were read.
[[nodiscard]] orbits::CycleTargetOptions cycle_targets(const Job& job);

/// An experiment from one initial state per segment.
/// @throws orbits::DataError when the data cannot serve it, naming the experiment.
[[nodiscard]] std::unique_ptr<orbits::SeriesResidual> single_shooting(const Job& job, std::size_t experiment,
                                                                      const EstimateSetup& setup,
                                                                      const Experiment& measured);

/// Adds a residual by single shooting per experiment of a series without nodes, and fills in starts of initial values
/// from the data where the job gives none.
/// @throws orbits::DataError when the data cannot serve it, naming the experiment.
void add_series(const Job& job, const std::vector<Experiment>& data, EstimateSetup& setup, JobResiduals& residuals);

/// A series with fewer readings than unknowns cannot be used. Parameters with a prior need no readings, and cycles give
/// more data than is counted here.
/// @throws orbits::DataError naming the experiments and both numbers.
void check_enough_readings(const Job& job, const EstimateSetup& setup, const JobResiduals& residuals);

}  // namespace orbid::apps
