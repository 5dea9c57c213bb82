#pragma once

#include <cstddef>
#include <memory>
#include <string_view>
#include <vector>

#include "models/system/kernel.hpp"

#pragma GCC visibility push(default)

namespace orbid::models {

/// A model in the form the registry takes: its texts and one kernel per variant, the default first.
struct ModelInstance {
    std::string_view name;
    std::string_view summary;
    std::string_view equations;
    std::vector<std::shared_ptr<const Kernel>> kernels;
    /// A DynamicModel: its kernel of any size >= smallest_size; the one in `kernels` has the default size.
    std::shared_ptr<const Kernel> (*kernel_of_size)(std::size_t size) = nullptr;
    std::size_t smallest_size = 0;
    std::size_t default_size = 0;
};

/// The instance of model M, a struct that satisfies DescribedModel or DynamicModel, or lists structs that satisfy the
/// former as its `variants`. Defined in model_kernel.hpp. The build writes one file for each line of registry.cpp and
/// compiles each model once; the registry needs only the name of the struct.
template <class M>
ModelInstance instance_of();

}  // namespace orbid::models

#pragma GCC visibility pop
