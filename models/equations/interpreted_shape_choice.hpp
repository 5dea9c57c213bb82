#pragma once

#include <cstddef>
#include <memory>
#include <string>

#include "models/equations/equations.hpp"
#include "models/system/kernel.hpp"

namespace orbid::models {

/// One of the shapes in interpreted_model.hpp.
struct InterpretedShapeChoice {
    std::shared_ptr<const Kernel> kernel;  ///< nothing: none fits
    std::size_t size = 0;                  ///< its number of coordinates
};

/// The smallest shape that fits a model; without one, `why` says what is too much for them.
[[nodiscard]] InterpretedShapeChoice interpreted_shape_for(const Equations& equations, std::string& why);

}  // namespace orbid::models
