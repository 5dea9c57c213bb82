#pragma once

#include <cstddef>
#include <memory>

#include "models/system/kernel.hpp"

namespace orbid::models {

/// The kernel of one of the shapes in interpreted_model.hpp. The build compiles each in a file of its own, for the
/// machine it runs on, as it does models.
template <class Shape>
std::shared_ptr<const Kernel> interpreted_shape();
/// The same of one with any number of coordinates.
template <class Shape>
std::shared_ptr<const Kernel> interpreted_shape_of_size(std::size_t size);

}  // namespace orbid::models
