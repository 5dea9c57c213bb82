#pragma once

#include <memory>

#include "models/equations/interpreted_field.hpp"
#include "models/equations/interpreted_model.hpp"
#include "models/equations/interpreted_shape.hpp"
#include "models/kernels/model_kernel.hpp"

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
