#pragma once

#include <cstddef>
#include <span>

#include "models/equations/staged_equations.hpp"
#include "models/formulas/formula_code.hpp"

namespace orbid::models {

/// The instructions of a model.
///
/// @param places  of the parameters in the array that `constants` reads
/// @throws std::length_error when formulas need more registers than there are
[[nodiscard]] EquationProgram equation_program(const Equations& equations, std::span<const std::size_t> places);

}  // namespace orbid::models
