#pragma once

#include <functional>
#include <string>
#include <vector>

#include "estimator/estimate/estimate.hpp"
#include "identification/problem/estimate_setup.hpp"
#include "identification/problem/identification_problem.hpp"
#include "identification/problem/problem_residuals.hpp"

namespace orbid::identification {

/// The estimate from exactly matched series, with the course looked for again where it misses: intervals do not meet
/// the next node, or lie far from a reading (missed_places()).
///
/// Errors of readings grow a hundredfold and more over some intervals of a chaotic record. There the ends of the
/// courses from the error ball of a node fold over the next one, and a minimisation from the readings may stop on the
/// wrong side, with links or readings that no error explains. So for each of these nodes the states are sought from
/// which the model explains the readings up to the next node: from 8 states drawn from its error ball. With each of
/// them the piece of 4 nodes on either side is estimated by itself, with normal links that begin loose. Where that
/// misses less, the estimate goes on from there. Where nothing is gained so, 64 states and 8 nodes are tried. Sixteen
/// rounds at most. Where errors of readings turn out smaller without the wrong courses, links are tightened in
/// proportion (ShootingResidual::tighten()) and looked at again.
///
/// Where more than half of the intervals miss, the model is wrong or far away, and the estimate is returned as it is.
/// @param told  what was mended, one line per round; may be empty.
[[nodiscard]] estimator::Estimate with_mended_links(const IdentificationProblem& problem, const EstimateSetup& setup,
                                                    const std::vector<estimator::FreeParameter>& parameters,
                                                    const ProblemResiduals& residuals,
                                                    const estimator::EstimateOptions& options,
                                                    estimator::Estimate estimate,
                                                    const std::function<void(const std::string& line)>& told);

}  // namespace orbid::identification
