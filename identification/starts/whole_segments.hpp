#pragma once

#include <string>

#include "identification/problem/identification_problem.hpp"
#include "identification/problem/problem_residuals.hpp"
#include "orbits/series_residuals/series_residual.hpp"

namespace orbid::identification {

/// How many times the effect of a small change of the first state grows along a segment, the most of all segments: the
/// largest derivative of the readings of the last tenth over that of the first tenth, by each component of the first
/// state. Derivatives count in the root mean square of the readings of their tenth, so that neither units nor records
/// that grow as a whole matter. 0: it cannot be told, since there are fewer than 20 readings of a coordinate, no free
/// first state, or a flow that does not reach the end.
///
/// @param theta  where it is computed, natural units, in the order of the estimate's parameters.
[[nodiscard]] double error_growth(const orbits::SeriesResidual& residual, const Eigen::VectorXd& theta);

/// Where the errors of the first state grow along a segment as no course in one piece can follow (a thousandfold), and
/// how much, as a sentence without its end; empty: nowhere.
///
/// @param residuals  of whole segments of the problem.
[[nodiscard]] std::string unbearable_growth(const IdentificationProblem& problem, const ProblemResiduals& residuals,
                                            const Eigen::VectorXd& theta);

/// Gives nodes to a series that asks for them where errors grow (SeriesChoice::unless_errors_grow).
/// @return what was found, as a sentence; empty: the series stays as it is
/// @throws orbits::DataError when the data cannot serve it, naming the experiment.
[[nodiscard]] std::string divide_where_errors_grow(IdentificationProblem& problem);

}  // namespace orbid::identification
