#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include <Eigen/Core>

#include "estimator/estimate/estimate.hpp"
#include "identification/problem/estimate_setup.hpp"
#include "identification/problem/problem_residuals.hpp"

namespace orbid::identification {

/// Where an estimate by multiple shooting begins.
struct SeriesStart {
    Eigen::VectorXd theta;                            ///< the estimator's vector
    std::vector<std::size_t> intervals;               ///< by experiment of the series; empty: as the problem says
    std::vector<std::vector<Eigen::MatrixXd>> nodes;  ///< by experiment and fitted segment; empty: guessed
    std::vector<std::vector<double>> reading_sds;     ///< by experiment and group of readings; empty: unknown
    bool follows = false;  ///< the model follows every record to within the errors of its readings: match exactly
    /// Readings tell no states, no attempt explains them, and no two attempts have come to the same: the end of an
    /// estimate from here is one of several.
    bool doubtful = false;
    bool several_ends = false;     ///< the same, also where readings tell the states
    std::uint64_t affordable = 0;  ///< work that an estimate from here may cost; 0: any
    int attempts = 0;              ///< that were made
    int iterations = 0;
    int evaluations = 0;
};

/// Intervals and nodes of an estimate.
[[nodiscard]] SeriesStart nodes_at(const ProblemResiduals& residuals, const estimator::Estimate& estimate);

/// States that were followed along the records of a problem, for residuals that begin at the same parameters.
struct FollowedRecords {
    Eigen::VectorXd theta;                                              ///< the estimator's vector
    std::vector<std::shared_ptr<const orbits::FollowedSeries>> series;  ///< by experiment of the series
    std::uint64_t work = 0;                                             ///< of all that was followed here
};

/// Adds a residual by multiple shooting per experiment of the series, its nodes guessed at `start.theta` unless it has
/// them.
/// @param flow      of the nodes; nothing: as accurate and as long as needed.
/// @param followed  used where it has the same parameters, and filled; nullptr: states are followed anew.
/// @throws orbits::DataError when the data do not suffice, naming the experiment.
void add_shooting(const IdentificationProblem& problem, const EstimateSetup& setup, const SeriesStart& start,
                  ProblemResiduals& residuals, const std::optional<models::FlowOptions>& flow = std::nullopt,
                  FollowedRecords* followed = nullptr);

/// Where a piece of a record begins.
struct SeriesPiece {
    std::size_t place = 0;    ///< of the experiment among those of the series
    std::size_t segment = 0;  ///< among the fitted ones
    Eigen::Index node = 0;    ///< of the segment
};

/// The residual of a piece of a record alone, with exact matching: of its nodes, shape (n, nodes), and all readings up
/// to the next one. Errors are those of `start`, where it knows them, and not estimated.
/// @throws orbits::DataError when the piece has no readings.
[[nodiscard]] std::unique_ptr<orbits::ShootingResidual> shooting_piece(
    const IdentificationProblem& problem, const EstimateSetup& setup, const SeriesStart& start,
    const SeriesPiece& piece, const Eigen::MatrixXd& nodes, const models::FlowOptions& flow = {});

}  // namespace orbid::identification
