#pragma once

#include <memory>
#include <span>

#include "models/definition/parameter.hpp"
#include "models/formulas/formula_code.hpp"
#include "models/system/kernel.hpp"

namespace orbid::models {

/// The kernel of a program in one of the shapes in interpreted_model.hpp. Like a model, each is compiled in a file of
/// its own for the machine that builds it.
///
/// @param coordinates  as many as the shape has; like the program, they must outlive the kernel
template <class Shape>
std::shared_ptr<const Kernel> interpreted_shape(const EquationProgram& program,
                                                std::span<const Coordinate> coordinates);

}  // namespace orbid::models
