#pragma once

#include <memory>

#include "models/detail/kernel_system.hpp"
#include "models/detail/model_kernel.hpp"

namespace orbid::models {

/// A model that is not in the registry behind the plain types of System; one of any size has its default size.
template <class M>
class ModelSystem final : public KernelSystem {
public:
    ModelSystem() : KernelSystem(instance_of<M>().kernels.front()) {}
};

}  // namespace orbid::models
