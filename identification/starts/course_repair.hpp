#pragma once

#include <cstdint>
#include <limits>
#include <string>
#include <vector>

#include "estimator/interface/estimate_options.hpp"
#include "identification/problem/estimate_setup.hpp"
#include "identification/problem/identification_problem.hpp"
#include "identification/starts/series_nodes.hpp"
#include "models/definition/simulation.hpp"

namespace orbid::identification {

/// Names of coordinates whose signs may be turned together: equations and readings stay as they are.
using SignChoices = std::vector<std::vector<std::string>>;

/// What a course becomes where another side suits its readings better.
struct CourseRepair {
    SeriesStart start;       ///< with other nodes
    int changed = 0;         ///< places where the course changes to the other side, or no longer does
    double gain = 0.0;       ///< of the objective, as the pieces tell, summed
    std::uint64_t work = 0;  ///< of all pieces, see ShootingResidual::work()
};

/// What a piece of a course may cost.
struct RepairLimits {
    models::FlowOptions flow{};  ///< of its intervals
    std::uint64_t work = std::numeric_limits<std::uint64_t>::max();
};

/// Looks for places where a course of the model is on the wrong side of a symmetry.
///
/// Let S turn the signs of coordinates, with S f(x) = f(S x) and the readings at S x those at x. Where a course passes
/// near S x = x, readings hardly tell whether it goes on at x or at S x, and both go on with the same readings. A
/// minimisation does not get from one to the other. So at each place where S x is near x, the piece around it is
/// estimated by itself, as it is and with the signs turned from there on: a few turns of the readings, with exact
/// matching, and with parameters that have normal priors as wide as their sds. The objectives of both tell.
///
/// @param start     theta, nodes, intervals and the sds of readings where they are known.
/// @param estimate  from which `start` comes, by multiple shooting alone.
/// @param limits    of the pieces: those that would go beyond tell nothing.
[[nodiscard]] CourseRepair repaired_course(const IdentificationProblem& problem, const EstimateSetup& setup,
                                           const std::vector<estimator::FreeParameter>& parameters,
                                           const SignChoices& signs, const SeriesStart& start,
                                           const estimator::Estimate& estimate,
                                           const estimator::EstimateOptions& options, const RepairLimits& limits = {});

}  // namespace orbid::identification
