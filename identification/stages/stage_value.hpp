#pragma once

#include <optional>
#include <string>
#include <vector>

#include "estimator/estimate/estimate.hpp"
#include "estimator/exploration/multi_start.hpp"
#include "identification/starts/cycle_start.hpp"
#include "identification/starts/series_nodes.hpp"
#include "orbits/cycles/cycle_search.hpp"

namespace orbid::identification {

/// The costly results of a finished stage of a strategy, for a run that continues from it. Residuals are rebuilt from
/// them.
struct StageValue {
    std::string skipped;                        ///< the reason; empty: it ran
    std::optional<orbits::CycleSearch> search;  ///< of a harvest: all cycles, new ones included
    Eigen::VectorXd prediction;                 ///< start of a prediction
    CycleStart cycles;                          ///< start from cycles
    SeriesStart series;                         ///< start from series with nodes
    Eigen::VectorXd best_start;                 ///< of several starts; empty: only one
    std::vector<estimator::Optimum> optima;
    std::vector<estimator::StartedRun> runs;
    estimator::Estimate estimate;  ///< as the estimator returned it
};

}  // namespace orbid::identification
