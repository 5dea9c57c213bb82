#pragma once

#include <memory>

#include "models/equations/interpreted_field.hpp"
#include "models/equations/interpreted_model.hpp"
#include "models/equations/interpreted_shape.hpp"
#include "models/kernels/model_kernel.hpp"

namespace orbid::models {

template <class Shape>
std::shared_ptr<const Kernel> interpreted_shape(const EquationProgram& program,
                                                std::span<const Coordinate> coordinates) {
    const Shape model(program, coordinates);
    if constexpr (DynamicModel<Shape>)
        return std::make_shared<DynamicKernel<Shape>>(coordinates.size(), model);
    else
        return std::make_shared<ModelKernel<Shape>>(model);
}

}  // namespace orbid::models
