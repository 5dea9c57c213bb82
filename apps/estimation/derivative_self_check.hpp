#pragma once

#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "apps/estimation/estimate_residuals.hpp"
#include "apps/estimation/estimate_setup.hpp"
#include "apps/stages/data_stage.hpp"
#include "apps/stages/workspace.hpp"
#include "models/system/system.hpp"
#include "orbits/cycles/cycle_search.hpp"

namespace orbid::apps {

/// The derivatives of a model are not those of its equations: no estimate from them can be right.
class WrongModel : public std::runtime_error {
    using std::runtime_error::runtime_error;
};

/// A flow whose derivatives are compared with differences.
struct FlowStart {
    std::shared_ptr<const models::System> system;
    Eigen::VectorXd state;  ///< shape (n)
    double phase = 0.0;
    std::vector<double> durations;
    models::Clock clock = models::Clock::time;
    Eigen::VectorXd theta;           ///< shape (q)
    std::vector<Eigen::Index> free;  ///< parameters that are estimated
};

/// The first flow of an estimate, at the start values: the first ten intervals of the first fitted segment, or from a
/// point of the first cycle to the next section. Empty when there is neither, or its state is not finite.
[[nodiscard]] std::optional<FlowStart> first_flow(const Job& job, const std::vector<Experiment>& data,
                                                  const orbits::CycleSearch& search, const EstimateSetup& setup,
                                                  const JobResiduals& residuals,
                                                  const models::ParameterBinding& cycle_binding);

/// Compares the derivatives of a flow with differences, and describes their agreement in one line. Models of more than
/// 100 directions are skipped, which the line says: the cost grows with the square of their number.
/// @throws WrongModel naming the entry that disagrees worst.
[[nodiscard]] std::string compare_derivatives(const FlowStart& start);

}  // namespace orbid::apps
