#pragma once

#include <cstddef>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include "apps/job/job.hpp"
#include "apps/results/result_file.hpp"
#include "estimator/estimate/estimate.hpp"
#include "identification/problem/problem_waveform.hpp"

namespace orbid::apps {

using identification::ProblemWaveform;

/// One row per reading, in time order within a channel.
/// @param values  of the estimate, one per block; lost records (empty) are left out.
void add_waveform_rows(const Job& job, const ProblemWaveform& waveform, const estimator::Estimate& estimate,
                       const std::vector<estimator::BlockValue>& values, std::vector<ResidualRow>& rows);

/// Phases, offsets and periodic solutions at the estimate.
/// @param latents, sds  of the estimate, one per block; `sds` may be empty.
void add_steady_states(const Job& job, const ProblemWaveform& waveform, const estimator::ActiveSet& active,
                       const Eigen::VectorXd& theta, const std::vector<Eigen::VectorXd>& latents,
                       const std::vector<Eigen::VectorXd>& sds, ResultContext& context);

/// One plot per observed coordinate: name of the file and its content.
[[nodiscard]] std::vector<std::pair<std::string, std::string>> waveform_plots(
    const Job& job, const ProblemWaveform& waveform, const estimator::ActiveSet& active, const Eigen::VectorXd& theta,
    const std::vector<Eigen::VectorXd>& latents);

}  // namespace orbid::apps
