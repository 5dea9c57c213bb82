#pragma once

#include <vector>

#include <Eigen/Core>

#include "orbits/cycles/model_guided_search.hpp"
#include "orbits/sections/section_points.hpp"

namespace orbid::orbits {

/// An orbit of the model as it would appear in a series, in the scaled units of SectionPoints.
struct ExpectedCycle {
    Eigen::MatrixXd points;    ///< shape (n, p), readings, wrapped
    Eigen::VectorXd variance;  ///< shape (n p), coordinate fastest: of the prediction, by the errors of theta
};

/// The model's orbits of the requested periods, one of every mirror pair if the search has a symmetry, those of each
/// period by ascending instability. States of rest and orbits that stick are left out: they cannot be measured.
/// @throws std::invalid_argument as harvest.
[[nodiscard]] std::vector<ExpectedCycle> expected_cycles(const Series& series, const SectionPoints& section,
                                                         const models::System& system, const Eigen::VectorXd& theta,
                                                         const ModelGuidedSearchOptions& options);

/// Largest over all coordinates of |measured - expected| / sd, the sds of both added squared, where the measured points
/// are turned by `shift` places. Shapes (n, p), (n p).
[[nodiscard]] double distance_in_sds(const SectionPoints& section, const ExpectedCycle& expected,
                                     const Eigen::MatrixXd& points, const Eigen::VectorXd& variance,
                                     Eigen::Index shift);

/// The same for the best shift; with a symmetry, of the points or their mirror image.
[[nodiscard]] double distance_in_sds(const SectionPoints& section, const ExpectedCycle& expected,
                                     const Eigen::MatrixXd& points, const Eigen::VectorXd& variance);

}  // namespace orbid::orbits
