#pragma once

#include <string>
#include <vector>

#include "identification/problem/estimate_setup.hpp"
#include "identification/problem/identification_problem.hpp"
#include "identification/problem/structural_report.hpp"

namespace orbid::identification {

/// Which parameters, and first states of segments, the readings of a problem's series can determine at all.
///
/// A test of local structural identifiability: the rank of the derivatives of readings along courses of the model, with
/// respect to the parameters that are estimated and the states where courses begin. Courses begin at states of the
/// record, what is not read at generic values, at three sets of parameters within a tenth of the start. Deficient is
/// what all of them say. Parameters with a proper prior other than a uniform one need no readings.
///
/// Examined are series of samples alone, of flows; the report says why others are not.
///
/// @param setup  of estimate_setup()
/// @throws orbits::DataError naming experiment, rule and cure: a reading that depends on nothing that is unknown, a
///         coordinate that never acts on what is measured
/// Cost: for a system of 5 coordinates and 15 parameters about 0.1 s.
[[nodiscard]] StructuralReport structural_report(const IdentificationProblem& problem, const EstimateSetup& setup);

/// Holds parameters at their start values (bounds without width), one for each undetermined direction.
void hold(const StructuralReport& report, std::vector<estimator::FreeParameter>& parameters);

/// What to tell before the fit, a line each.
[[nodiscard]] std::vector<std::string> remarks(const StructuralReport& report);

}  // namespace orbid::identification
