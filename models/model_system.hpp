#pragma once

#include <memory>

#include "models/kernel_system.hpp"
#include "models/model_kernel.hpp"

namespace orbid::models {

/// A model that is not in the registry behind the plain types of System.
template <DescribedModel M>
class ModelSystem final : public KernelSystem {
public:
    ModelSystem() : KernelSystem(std::make_shared<ModelKernel<M>>()) {}
};

}  // namespace orbid::models
