#include <cmath>
#include <memory>
#include <stdexcept>
#include <utility>

#include <fmt/format.h>

#include "models/system/kernel_system.hpp"

namespace orbid::models {

std::shared_ptr<const System> KernelSystem::with_input(std::shared_ptr<const InputSignal> signal) const {
    if (inputs().empty()) throw std::invalid_argument(fmt::format("model {} has no measured inputs", name()));
    if (!signal || signal->count() != inputs().size())
        throw std::invalid_argument(fmt::format("model {}: the signal has {} inputs, must have {}", name(),
                                                signal ? signal->count() : 0, inputs().size()));
    auto system = std::make_shared<KernelSystem>(*this);
    system->signal_ = std::move(signal);
    return system;
}

std::shared_ptr<const System> KernelSystem::with_stop(std::function<bool()> interrupted) const {
    auto system = std::make_shared<KernelSystem>(*this);
    system->interrupted_ = std::move(interrupted);
    return system;
}

std::shared_ptr<const System> KernelSystem::with_state_size(double size) const {
    if (!(std::isfinite(size) && size > 0.0))
        throw std::invalid_argument(
            fmt::format("model {}: the size of its states is {}, must be finite and > 0", name(), size));
    auto system = std::make_shared<KernelSystem>(*this);
    system->state_size_ = size;
    return system;
}

FlowOptions KernelSystem::for_kernel(FlowOptions options) const {
    options.absolute_tolerance *= state_size_;
    if (options.interrupted == nullptr && interrupted_) options.interrupted = &interrupted_;
    return options;
}

}  // namespace orbid::models
