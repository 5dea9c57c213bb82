#pragma once

#include <memory>

#include "models/detail/model_kernel.hpp"
#include "models/interpreted_field.hpp"
#include "models/interpreted_model.hpp"
#include "models/interpreted_shape.hpp"

namespace orbid::models {

template <class Shape>
std::shared_ptr<const Kernel> interpreted_shape() {
    return std::make_shared<ModelKernel<Shape>>();
}

template <class Shape>
std::shared_ptr<const Kernel> interpreted_shape_of_size(std::size_t size) {
    return std::make_shared<DynamicKernel<Shape>>(size);
}

}  // namespace orbid::models
