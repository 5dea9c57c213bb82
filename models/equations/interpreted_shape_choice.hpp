#pragma once

#include <cstddef>
#include <memory>
#include <span>
#include <string>

#include "models/equations/equations.hpp"
#include "models/formulas/formula_code.hpp"
#include "models/system/kernel.hpp"

namespace orbid::models {

/// One of the shapes in interpreted_model.hpp.
struct InterpretedShapeChoice {
    /// interpreted_shape() of it; nullptr: none fits
    std::shared_ptr<const Kernel> (*kernel)(const EquationProgram&, std::span<const Coordinate>) = nullptr;
    std::size_t size = 0;  ///< its number of coordinates
};

/// The smallest shape that fits a model; without one, `why` says what is too much for them.
[[nodiscard]] InterpretedShapeChoice interpreted_shape_for(const Equations& equations, std::string& why);

}  // namespace orbid::models
