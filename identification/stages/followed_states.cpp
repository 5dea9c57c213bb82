#include <algorithm>

#include "identification/stages/strategy_stage.hpp"

namespace orbid::identification {

std::vector<FollowedStates> followed_states(const StageRun& run) {
    std::vector<FollowedStates> all;
    if (!run.usable() || !run.is_evaluated()) return all;
    const auto list = run.residuals.all();
    for (std::size_t r = 0; r < list.size(); ++r) {
        const auto shooting = std::find_if(run.residuals.shooting.begin(), run.residuals.shooting.end(),
                                           [&](const auto& one) { return one.get() == list[r]; });
        if (shooting == run.residuals.shooting.end()) continue;
        if ((*shooting)->series().sampling != orbits::Series::Sampling::samples) continue;
        const std::size_t experiment =
            run.residuals.shooting_experiments[static_cast<std::size_t>(shooting - run.residuals.shooting.begin())];
        const auto& nodes = (*shooting)->plan().nodes;
        const auto& latents = run.estimate.latents[r];
        for (std::size_t first = 0; first < nodes.size();) {
            std::size_t end = first;
            while (end < nodes.size() && nodes[end].segment == nodes[first].segment)
                ++end;
            FollowedStates& own = all.emplace_back();
            own.experiment = experiment;
            own.segment = nodes[first].segment;
            own.times.resize(static_cast<Eigen::Index>(end - first));
            own.states.resize(latents[first].size(), own.times.size());
            const Eigen::VectorXd& times = (*shooting)->series().segments[own.segment].times;
            for (std::size_t b = first; b < end; ++b) {
                own.times[static_cast<Eigen::Index>(b - first)] = times[nodes[b].sample];
                own.states.col(static_cast<Eigen::Index>(b - first)) = latents[b];
            }
            first = end;
        }
    }
    return all;
}

}  // namespace orbid::identification
