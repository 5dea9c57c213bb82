#pragma once

#include <memory>
#include <string_view>
#include <vector>

#include "models/system.hpp"

namespace orbid::models {

/// A model as the registry takes it: its texts and one system per variant, the default first.
struct ModelInstance {
    std::string_view name;
    std::string_view summary;
    std::string_view equations;
    std::vector<std::shared_ptr<const System>> systems;
};

// One function per model, each defined in the model's own .cpp: its templates are compiled there and nowhere else.
ModelInstance duffing_model();
ModelInstance free_pendulum_model();
ModelInstance lotka_volterra_model();
ModelInstance parametric_pendulum_model();

}  // namespace orbid::models
