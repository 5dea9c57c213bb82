#pragma once

#include <cstddef>
#include <span>

#include "models/equations/staged_equations.hpp"
#include "models/formulas/formula_code.hpp"

namespace orbid::models {

/// Instructions that compute these formulas.
///
/// @param places  of the parameters among the variables, where they do not stand in their order
/// @throws std::length_error when more registers are needed than there are
[[nodiscard]] FormulaCode formula_code(const ExpressionGraph& graph, std::span<const ExpressionGraph::Node> results,
                                       std::span<const std::size_t> places = {});

/// The instructions of a model.
///
/// @param places  of the parameters in the array that `constants` reads
/// @throws std::length_error when formulas need more registers than there are
[[nodiscard]] EquationProgram equation_program(const Equations& equations, std::span<const std::size_t> places);

}  // namespace orbid::models
