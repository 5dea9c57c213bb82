#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <span>
#include <string_view>
#include <vector>

#include "models/system/system.hpp"

#pragma GCC visibility push(default)

namespace orbid::models {

/// Numbers of cells that a model whose dimension is chosen may have.
struct ModelSize {
    /// The sensitivities of one state take 0.8 GB there.
    static constexpr std::size_t largest = 10000;
    std::size_t smallest;
    std::size_t standard;  ///< when none is chosen
};

/// What the registry knows about a model without building it.
struct ModelEntry {
    std::string_view name;
    std::string_view summary;                ///< one line
    std::string_view equations;              ///< several lines, as in the doc comment of the model
    std::vector<std::string_view> variants;  ///< the first is the default; empty when there are none
    std::optional<ModelSize> size;           ///< nothing: the dimension is part of the equations
};

/// All models, in alphabetical order.
[[nodiscard]] std::span<const ModelEntry> registered_models();

/// The system of a model by name, variant ("" = the default variant) and number of cells (nothing = the standard size).
/// @throws std::invalid_argument naming the choices when there is no such model or variant, and the allowed sizes when
///         the size is wrong. Also when a size is given to a model of fixed size.
[[nodiscard]] std::shared_ptr<const System> make_system(std::string_view name, std::string_view variant = "",
                                                        std::optional<std::size_t> size = std::nullopt);

}  // namespace orbid::models

#pragma GCC visibility pop
