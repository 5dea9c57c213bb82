#include "models/parametric_pendulum.hpp"

#include "models/model_instances.hpp"
#include "models/model_system.hpp"

namespace orbid::models {

namespace {
using Crank = ParametricPendulum<Support::crank>;
using CrankAsPrinted = ParametricPendulum<Support::crank_as_printed>;
using Harmonic = ParametricPendulum<Support::harmonic>;
}  // namespace

static_assert(DescribedModel<Crank> && ForcedModel<Crank> && SwitchingModel<Crank> && SymmetricModel<Crank> &&
              VariantModel<Crank> && ReducedModel<Crank>);

ModelInstance parametric_pendulum_model() {
    return {Crank::name,
            Crank::summary,
            Crank::equations,
            {std::make_shared<ModelSystem<Crank>>(), std::make_shared<ModelSystem<CrankAsPrinted>>(),
             std::make_shared<ModelSystem<Harmonic>>()}};
}

}  // namespace orbid::models
