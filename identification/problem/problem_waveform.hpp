#pragma once

#include <cstddef>
#include <memory>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "identification/problem/estimate_setup.hpp"
#include "periodic/waveforms/waveform_residual.hpp"

namespace orbid::identification {

/// The waveform residual of a problem, and the origin of its blocks.
struct ProblemWaveform {
    std::unique_ptr<periodic::WaveformResidual> residual;  ///< empty: there is none
    struct Place {
        std::size_t experiment;  ///< index of the experiment
        std::size_t segment;     ///< of its series
    };
    std::vector<Place> places;  ///< one per block
};

/// Makes it, with a record per fitted segment of its experiments and first solutions at `start`.
/// @return one line per record whose orbit was not found, when others have theirs
/// @throws orbits::DataError when the data do not suffice or no record has an orbit, naming the experiments.
[[nodiscard]] std::vector<std::string> add_waveform(const IdentificationProblem& problem, const EstimateSetup& setup,
                                                    const Eigen::VectorXd& start, ProblemWaveform& waveform);

}  // namespace orbid::identification
