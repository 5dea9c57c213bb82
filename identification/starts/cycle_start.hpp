#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "estimator/estimate/estimate.hpp"
#include "orbits/cycle_residuals/cycle_target.hpp"

namespace orbid::identification {

/// What the search for a start from measured cycles is given.
struct CycleStartProblem {
    std::shared_ptr<const models::System> system;
    const models::ParameterBinding& binding;
    const std::vector<orbits::Cycle>& cycles;
    orbits::SectionPlace place;
    orbits::CycleTargetOptions targets;
};

struct CycleStartOptions {
    estimator::EstimateOptions estimate;  ///< of the final estimate; stages are rougher
    /// First of all, one-period predictions are compared on a ladder about the start.
    bool scan = true;
    std::function<void(const std::string& line)> log;  ///< one line per stage; empty: none
    /// Steps of the stages, with the stage's name; empty: not told.
    std::function<void(const std::string& stage, const estimator::StepReport& report)> watched{};
    /// The best values so far, shape (parameters); empty: not told.
    std::function<void(const Eigen::VectorXd& theta)> reached{};
};

/// A good start for the estimate from measured cycles.
struct CycleStart {
    Eigen::VectorXd theta;               ///< the estimator's vector
    std::vector<Eigen::MatrixXd> nodes;  ///< of the orbits at theta, per measured cycle; empty: no orbit
    int iterations = 0;
    int evaluations = 0;
};

/// From a far start to the neighbourhood of the optimum. After a coarse scan and one-period prediction, orbits and
/// parameters are improved together while the sd of the matching conditions falls in stages. The caller's last step is
/// CycleResidual, whose orbits are exact.
///
/// (Re-solved orbits alone reach the optimum from 15 % of wide starts; most others slide onto wrong orbits.)
[[nodiscard]] CycleStart start_from_cycles(const CycleStartProblem& problem,
                                           const std::vector<estimator::FreeParameter>& parameters,
                                           const CycleStartOptions& options);

}  // namespace orbid::identification
