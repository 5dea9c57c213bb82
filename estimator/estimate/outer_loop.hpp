#pragma once

#include <vector>

#include "estimator/interface/estimate_result.hpp"
#include "estimator/minimisation/minimum.hpp"
#include "estimator/problem/problem.hpp"

namespace orbid::estimator {

/// The rounds of one estimate: minimise, take out blocks that stopped, let the residuals look again.
class OuterLoop {
public:
    /// @param active  with which the first minimisation begins.
    OuterLoop(const Problem& problem, State& state, std::vector<ActiveSet> active);

    /// @throws models::Stopped when a stop comes before there is anything.
    void run();

    BlockSet set;
    Minimum minimum;
    SolverStatistics ledger;
    std::vector<ResidualCount> counts;

private:
    bool minimise_next();
    bool go_on(int& provisional);
    bool suspend_stopped();
    bool update_active_set();
    void restore();
    void read_scales(const BlockSet& next);
    void adopt_latents(std::size_t residual, const std::vector<bool>& was_active);

    const Problem& problem_;
    State& state_;
    /// The sets of the last minimisation as far as update_active_set() has changed them since: without blocks where
    /// these are the same.
    std::vector<ActiveSet> earlier_;
};

}  // namespace orbid::estimator
