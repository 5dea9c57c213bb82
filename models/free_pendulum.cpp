#include "models/free_pendulum.hpp"

#include "models/model_instances.hpp"
#include "models/model_system.hpp"

namespace orbid::models {

static_assert(DescribedModel<FreePendulum>);

ModelInstance free_pendulum_model() {
    return {FreePendulum::name,
            FreePendulum::summary,
            FreePendulum::equations,
            {std::make_shared<ModelSystem<FreePendulum>>()}};
}

}  // namespace orbid::models
