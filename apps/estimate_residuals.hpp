#pragma once

#include <cstddef>
#include <memory>
#include <vector>

#include "apps/data_stage.hpp"
#include "apps/estimate_setup.hpp"
#include "apps/estimate_waveform.hpp"
#include "apps/job.hpp"
#include "estimator/residual.hpp"
#include "orbits/cycle_residual.hpp"
#include "orbits/series_residual.hpp"

namespace orbid::apps {

/// The residuals of a job, each kept by its own type: results are read back from them.
struct JobResiduals {
    std::unique_ptr<orbits::CycleResidual> cycles;
    std::vector<std::unique_ptr<orbits::SeriesResidual>> series;
    std::vector<std::size_t> experiments;  ///< of `series`: index into Job::data
    JobWaveform waveform;

    /// Cycles, then series, then the waveform.
    [[nodiscard]] std::vector<estimator::Residual*> all() const;
};

/// Labels of the fitted segments of every experiment that a series residual uses; empty for the others.
/// @throws orbits::DataError naming a segment that is not there.
[[nodiscard]] std::vector<std::vector<std::string>> fitted_labels(const Job& job, const std::vector<Experiment>& data);

/// What the measured cycles weigh with, and how their errors are distributed.
[[nodiscard]] orbits::CycleTargetOptions cycle_targets(const CyclesResidualJob& job);

/// Adds a series residual per experiment of the job, and fills in the starts of initial values that the job leaves to
/// the data.
/// @throws orbits::DataError when the data cannot serve it, naming the experiment.
void add_series(const Job& job, const std::vector<Experiment>& data, EstimateSetup& setup, JobResiduals& residuals);

/// A series with fewer readings than unknowns cannot be used, whatever the estimator does; parameters with a prior may
/// do without readings, and cycles bring more than is counted here.
/// @throws orbits::DataError naming the experiments and both numbers.
void check_enough_readings(const Job& job, const EstimateSetup& setup, const JobResiduals& residuals);

}  // namespace orbid::apps
