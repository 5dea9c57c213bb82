#pragma once

#include <cstddef>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "estimator/estimate/estimate.hpp"
#include "identification/problem/estimate_setup.hpp"
#include "identification/problem/identification_options.hpp"
#include "identification/problem/problem_residuals.hpp"

namespace orbid::identification {

/// Where an estimate by multiple shooting begins.
struct SeriesStart {
    Eigen::VectorXd theta;                            ///< the estimator's vector
    std::vector<std::size_t> intervals;               ///< by experiment of the series; empty: as the problem says
    std::vector<std::vector<Eigen::MatrixXd>> nodes;  ///< by experiment and fitted segment; empty: guessed
    std::vector<std::vector<double>> reading_sds;     ///< by experiment and group of readings; empty: unknown
    bool follows = false;  ///< the model follows every record to within the errors of its readings: match exactly
    int attempts = 0;      ///< that were made
    int iterations = 0;
    int evaluations = 0;
};

/// Intervals and nodes of an estimate.
[[nodiscard]] SeriesStart nodes_at(const ProblemResiduals& residuals, const estimator::Estimate& estimate);

/// Adds a residual by multiple shooting per experiment of the series, its nodes guessed at `start.theta` unless it has
/// them.
/// @param flow  of the nodes; nothing: as accurate and as long as needed.
/// @throws orbits::DataError when the data do not suffice, naming the experiment.
void add_shooting(const IdentificationProblem& problem, const EstimateSetup& setup, const SeriesStart& start,
                  ProblemResiduals& residuals, const std::optional<models::FlowOptions>& flow = std::nullopt);

/// What a search for a start tells while it goes on. Anything may be empty.
struct SeriesSearch {
    estimator::EstimateOptions estimate;  ///< of the final estimate; attempts are rougher
    std::function<void(const std::string& attempt, const estimator::StepReport& report)> watched{};
    std::function<void(const std::string& line)> log{};
    std::function<void(const Eigen::VectorXd& theta)> reached{};
};

/// Whether an estimate by multiple shooting is worth a search for its start: something is not read, or the data decide
/// how closely nodes match.
[[nodiscard]] bool needs_search(const IdentificationProblem& problem);

/// A start from which the model follows the records, if one is found.
///
/// Attempts are estimates with exact matching, which begins loose and is tightened in stages, and with priors as wide
/// as the starts are large, so that nothing runs off while matching is loose. The first one begins at the parameters'
/// starts with the interval that they suggest. Others have intervals of an eighth and of a third of a turn. The rest
/// begins at random parameters, drawn from these priors with half their sd, where hidden states are looked for anew.
///
/// An attempt has succeeded when it converges and its residuals are those of the readings alone: as small as readings
/// scatter about a smooth course, see orbits::reading_noise(), and uncorrelated in time. Its nodes and parameters are
/// the start then, and matching stays exact. Otherwise the start is the best attempt where readings tell no states
/// without the model, and the problem's own where they do.
///
/// @param parameters  with their starts.
/// @throws orbits::DataError when no attempt can begin.
[[nodiscard]] SeriesStart search_series_start(const IdentificationProblem& problem, const Options& options,
                                              const EstimateSetup& setup,
                                              const std::vector<estimator::FreeParameter>& parameters,
                                              const SeriesSearch& search);

}  // namespace orbid::identification
