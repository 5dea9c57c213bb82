#include "models/lotka_volterra.hpp"

#include "models/model_instances.hpp"
#include "models/model_system.hpp"

namespace orbid::models {

static_assert(DescribedModel<LotkaVolterra>);

ModelInstance lotka_volterra_model() {
    return {LotkaVolterra::name,
            LotkaVolterra::summary,
            LotkaVolterra::equations,
            {std::make_shared<ModelSystem<LotkaVolterra>>()}};
}

}  // namespace orbid::models
