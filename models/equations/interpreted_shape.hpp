#pragma once

#include <cstddef>
#include <memory>

#include "models/system/kernel.hpp"

namespace orbid::models {

/// The kernel of one of the shapes in interpreted_model.hpp. Like a model, each is compiled in a file of its own for
/// the machine that builds it.
template <class Shape>
std::shared_ptr<const Kernel> interpreted_shape();
/// The same for a shape with any number of coordinates.
template <class Shape>
std::shared_ptr<const Kernel> interpreted_shape_of_size(std::size_t size);

}  // namespace orbid::models
