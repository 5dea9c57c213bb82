#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace orbid::apps {

/// One line per model: name and summary.
[[nodiscard]] std::string model_list();

/// One model: equations, variants, size, kind, coordinates, symmetry, measured inputs, sensors, parameters with unit,
/// domain, default and description.
/// @throws std::invalid_argument when no model has that name.
[[nodiscard]] std::string model_page(std::string_view name);

[[nodiscard]] std::vector<std::string> model_names();

}  // namespace orbid::apps
