#pragma once

#include <string>
#include <vector>

#include "identification/structure/course_draw.hpp"

namespace orbid::identification {

/// Coordinates whose signs may be turned together, parameters as they are: S f(x) = f(S x) with S = diag(+-1), and the
/// readings at S x are those at x, at all states of these courses. Sets that are made of others are left out.
///
/// Coordinates that begin at a given value other than 0, or have a prior or bounds there, have the sign of that.
/// Systems of more than eight coordinates are not examined.
[[nodiscard]] std::vector<std::vector<std::string>> sign_choices(const IdentificationProblem& problem,
                                                                 const EstimateSetup& setup, const CourseDraws& draws,
                                                                 const std::vector<CourseInformation>& courses);

}  // namespace orbid::identification
