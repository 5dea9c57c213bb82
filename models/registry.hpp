#pragma once

#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "models/system.hpp"

namespace orbid::models {

/// What the registry knows of a model without building it.
struct ModelEntry {
    std::string_view name;
    std::string_view summary;                ///< one line
    std::string_view equations;              ///< several lines, as in the doc comment of the model
    std::vector<std::string_view> variants;  ///< the first is the default; empty when there are none
};

/// All models, in alphabetical order.
[[nodiscard]] std::span<const ModelEntry> registered_models();

/// The system of a model by name and variant ("" = the default variant).
/// @throws std::invalid_argument naming what exists when there is no such model or variant.
[[nodiscard]] std::shared_ptr<const System> make_system(std::string_view name, std::string_view variant = "");

}  // namespace orbid::models
