#pragma once

#include <cstddef>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include "apps/estimation/estimate_setup.hpp"
#include "apps/results/result_file.hpp"
#include "apps/stages/data_stage.hpp"
#include "estimator/estimate/estimate.hpp"
#include "periodic/waveforms/waveform_residual.hpp"

namespace orbid::apps {

/// The waveform residual of a job, and the origin of its blocks.
struct JobWaveform {
    std::unique_ptr<periodic::WaveformResidual> residual;  ///< empty: the job has none
    struct Place {
        std::size_t experiment;  ///< index into Job::data
        std::size_t segment;     ///< of its series
    };
    std::vector<Place> places;  ///< one per block
};

/// Makes it, with a record per fitted segment of its experiments and first solutions at `start`.
/// @return one line per record whose orbit was not found, when others have theirs
/// @throws orbits::DataError when the data do not suffice or no record has an orbit, naming the experiments.
[[nodiscard]] std::vector<std::string> add_waveform(const Job& job, const std::vector<Experiment>& data,
                                                    const EstimateSetup& setup, const Eigen::VectorXd& start,
                                                    JobWaveform& waveform);

/// One row per reading, in time order within a channel.
/// @param values  of the estimate, one per block; lost records (empty) are left out.
void add_waveform_rows(const Job& job, const JobWaveform& waveform, const estimator::Estimate& estimate,
                       const std::vector<estimator::BlockValue>& values, std::vector<ResidualRow>& rows);

/// Phases, offsets and periodic solutions at the estimate.
/// @param latents, sds  of the estimate, one per block; `sds` may be empty.
void add_steady_states(const Job& job, const JobWaveform& waveform, const Eigen::VectorXd& theta,
                       const std::vector<Eigen::VectorXd>& latents, const std::vector<Eigen::VectorXd>& sds,
                       ResultContext& context);

/// One plot per observed coordinate: name of the file and its content.
[[nodiscard]] std::vector<std::pair<std::string, std::string>> waveform_plots(
    const Job& job, const JobWaveform& waveform, const Eigen::VectorXd& theta,
    const std::vector<Eigen::VectorXd>& latents);

}  // namespace orbid::apps
