#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "apps/job/job.hpp"

namespace orbid::apps {

/// Flows of a job by the library's own stepper and by Boost.Odeint.
struct FlowCheck {
    std::string over;                             ///< how long, in words: "3 periods of the forcing"
    std::vector<std::string> directions;          ///< names: the coordinates of the start, then the parameters
    std::size_t starts = 0;                       ///< flows compared
    std::size_t failed = 0;                       ///< flows that one of the two could not finish
    std::string failure;                          ///< of the last of those, in words
    std::size_t own_steps = 0, odeint_steps = 0;  ///< attempts of all flows
    double tolerance = 0.0;                       ///< of both
    /// Largest difference over starts and instants, shape (n, 1 + directions): of each coordinate the value, then its
    /// derivative by each direction, relative to the largest value of the same entry (0: both are 0 throughout).
    Eigen::MatrixXd differences;
};

/// Compares both from states of the job: those its simulations, orbits or waveforms start at, the first readings of its
/// records, else some that are typical of the model; over a few periods of the forcing, sampling intervals or seconds.
/// Parameters are at their starts; derivatives by those that are estimated, or by all at which the equations stay
/// smooth.
/// @throws std::invalid_argument where odeint_refusal() says why there is nothing to compare
[[nodiscard]] FlowCheck check_flows(const Job& job);

/// A table of it, for standard output.
[[nodiscard]] std::string flow_table(const Job& job, const FlowCheck& check);

}  // namespace orbid::apps
