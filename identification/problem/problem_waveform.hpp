#pragma once

#include <cstddef>
#include <memory>
#include <span>
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

/// States along a fitted segment, as an earlier estimate has followed them.
struct FollowedStates {
    std::size_t experiment = 0;
    std::size_t segment = 0;  ///< of its series
    Eigen::VectorXd times;    ///< shape (m) [s], ascending
    Eigen::MatrixXd states;   ///< shape (n, m)
};

/// Makes it, with a record per fitted segment of its experiments and first solutions at `start`. A period that is not
/// given is that of the record (orbits::record_period()). Where no start is given either, but states of the segment are
/// known, the solution is sought from one of them. Its period is then the first multiple of the record's, up to eight,
/// after which the states come back, too: readings may repeat before the states do, as x^2 where x changes sign.
/// @return one line per record: its period, where it was not given; that its orbit was not found, when others have
///         theirs
/// @throws orbits::DataError when the data do not suffice or no record has an orbit, naming the experiments.
[[nodiscard]] std::vector<std::string> add_waveform(const IdentificationProblem& problem, const EstimateSetup& setup,
                                                    const Eigen::VectorXd& start, ProblemWaveform& waveform,
                                                    std::span<const FollowedStates> followed = {});

}  // namespace orbid::identification
