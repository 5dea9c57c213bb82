#include "models/duffing.hpp"

#include "models/model_instances.hpp"
#include "models/model_system.hpp"

namespace orbid::models {

static_assert(DescribedModel<Duffing>);

ModelInstance duffing_model() {
    return {Duffing::name, Duffing::summary, Duffing::equations, {std::make_shared<ModelSystem<Duffing>>()}};
}

}  // namespace orbid::models
