#pragma once

#include "models/kernels/model_kernel.hpp"
#include "models/system/kernel_system.hpp"

namespace orbid::models {

/// A model that is not in the registry as a System; one of any size has its default size.
template <class M>
class ModelSystem final : public KernelSystem {
public:
    ModelSystem() : KernelSystem(instance_of<M>().kernels.front()) {}
};

}  // namespace orbid::models
