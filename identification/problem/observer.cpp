#include "identification/problem/observer.hpp"

#include <fmt/format.h>

namespace orbid::identification {

void Observer::step(const std::string& minimisation, const estimator::StepReport& report) {
    at(report.iteration,
       fmt::format("{}{}objective {:.6g}", minimisation, minimisation.empty() ? "" : ": ", report.objective));
}

}  // namespace orbid::identification
