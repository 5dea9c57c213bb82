#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "identification/problem/experiment.hpp"
#include "models/equations/equations.hpp"
#include "models/system/system.hpp"

namespace orbid::apps {

/// Whether equations of a job are compiled before they are used.
enum class CompileChoice { automatic, always, never };

struct ModelJob {
    std::string name;
    std::string variant;                                 ///< as the system names it; empty when the model has none
    std::optional<std::size_t> size;                     ///< number of cells, where the model allows a choice
    std::shared_ptr<const models::Equations> equations;  ///< a model written in the job; nothing: one of the registry
    CompileChoice compile = CompileChoice::automatic;    ///< of such a model
    bool compiled = false;                               ///< it is evaluated by compiled code
    std::shared_ptr<const models::System> system;
    Eigen::VectorXd values;  ///< shape (q): all parameters, for simulated data and fixed values

    [[nodiscard]] const models::Parameter& parameter(Eigen::Index index) const {
        return system->parameters()[static_cast<std::size_t>(index)];
    }
    [[nodiscard]] const models::Coordinate& coordinate(Eigen::Index index) const {
        return system->coordinates()[static_cast<std::size_t>(index)];
    }
    [[nodiscard]] bool is(models::Kind kind) const { return system && system->kind() == kind; }
};

/// As jobs write them, in the order of models::Domain.
inline const std::vector<std::string> domain_names{"any", "positive", "nonnegative"};

using identification::ParameterValue;

/// What takes the steps of all flows: the library's own steppers (Verner's pair for smooth motion), or Boost.Odeint.
enum class FlowStepper { verner, odeint };

/// As jobs write them, in the order of FlowStepper.
inline const std::vector<std::string> flow_stepper_names{"verner", "odeint"};

}  // namespace orbid::apps
