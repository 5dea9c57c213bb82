#include "models/catalogue/registry.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <stdexcept>

#include "models/kernels/model_instance.hpp"
#include "models/system/kernel_system.hpp"

namespace orbid::models {

/// The models, one line each, in any order. CMakeLists.txt reads the names in these lines: a struct FreePendulum is
/// taken from models/catalogue/free_pendulum.hpp, compiled on its own, and tested by
/// tests/models/catalogue/free_pendulum_test.cpp.
// clang-format off
static constexpr ModelInstance (*listed_models[])() = {
    &instance_of<struct DoublePendulum>,
    &instance_of<struct DrivenPendulum>,
    &instance_of<struct Duffing>,
    &instance_of<struct FitzhughNagumo>,
    &instance_of<struct FreePendulum>,
    &instance_of<struct Henon>,
    &instance_of<struct Ikeda>,
    &instance_of<struct LandingGearDamper>,
    &instance_of<struct Logistic>,
    &instance_of<struct Lorenz>,
    &instance_of<struct Lorenz96>,
    &instance_of<struct LotkaVolterra>,
    &instance_of<struct ParametricPendulum>,
    &instance_of<struct Rossler>,
    &instance_of<struct VanDerPol>,
};
// clang-format on

namespace {

struct Registered {
    ModelEntry entry;
    std::vector<std::shared_ptr<const System>> systems;  ///< one per variant, the default first
    std::shared_ptr<const Kernel> (*kernel_of_size)(std::size_t);
};

/// All models in alphabetical order. Systems hold no state, so one of each serves everybody.
const std::vector<Registered>& registered() {
    static const std::vector<Registered> all = [] {
        std::vector<Registered> models;
        for (const auto& instance_of_model : listed_models) {
            const ModelInstance instance = instance_of_model();
            Registered model{
                {instance.name, instance.summary, instance.equations, {}, {}}, {}, instance.kernel_of_size};
            if (instance.kernel_of_size != nullptr)
                model.entry.size = ModelSize{instance.smallest_size, instance.default_size};
            for (const auto& kernel : instance.kernels) {
                model.systems.push_back(std::make_shared<KernelSystem>(kernel));
                if (!kernel->variant().empty()) model.entry.variants.push_back(kernel->variant());
            }
            models.push_back(std::move(model));
        }
        std::sort(models.begin(), models.end(),
                  [](const Registered& a, const Registered& b) { return a.entry.name < b.entry.name; });
        return models;
    }();
    return all;
}

template <class Names>
std::string joined(const Names& names) {
    return fmt::format("{}", fmt::join(names, ", "));
}

}  // namespace

std::span<const ModelEntry> registered_models() {
    static const std::vector<ModelEntry> entries = [] {
        std::vector<ModelEntry> list;
        for (const Registered& model : registered())
            list.push_back(model.entry);
        return list;
    }();
    return entries;
}

std::shared_ptr<const System> make_system(std::string_view name, std::string_view variant,
                                          std::optional<std::size_t> size) {
    std::vector<std::string_view> names;
    for (const Registered& model : registered()) {
        names.push_back(model.entry.name);
        if (model.entry.name != name) continue;
        if (size && !model.entry.size)
            throw std::invalid_argument(
                fmt::format("size {}: model {} has a fixed number of coordinates", *size, name));
        if (size && !(*size >= model.entry.size->smallest && *size <= ModelSize::largest))
            throw std::invalid_argument(fmt::format("size {}: that of model {} must be >= {} and <= {}", *size, name,
                                                    model.entry.size->smallest, ModelSize::largest));
        if (size && variant.empty() && *size != model.entry.size->standard)
            return std::make_shared<KernelSystem>(model.kernel_of_size(*size));
        if (variant.empty()) return model.systems.front();
        for (const auto& system : model.systems)
            if (system->variant() == variant) return system;
        throw std::invalid_argument(
            model.entry.variants.empty()
                ? fmt::format("variant \"{}\": model {} has no variants", variant, name)
                : fmt::format("variant \"{}\": model {} has {}", variant, name, joined(model.entry.variants)));
    }
    throw std::invalid_argument(fmt::format("model \"{}\": there are {}", name, joined(names)));
}

}  // namespace orbid::models
