// The last solution of a block in the memory of an active set: ten vectors, in this order: status, phase, counts, T
// and rotation; place; scale; points; sensitivities; those of T; point and normal of the phase's origin; offsets; the
// parameter that moves with the orbit and its sensitivities.
#include "periodic/orbit/eigen_names.hpp"
#include "periodic/waveforms/steady_state_residual.hpp"

namespace orbid::periodic {

SteadyStateResidual::Known SteadyStateResidual::known(const estimator::ActiveSet& active, std::size_t block) {
    const VectorXd* part = &active.memory[memory_parts * block];
    const VectorXd& numbers = part[0];
    Known known;
    known.status = static_cast<OrbitStatus>(numbers[0]);
    known.phase = numbers[1];
    known.taken_back = static_cast<int>(numbers[2]);
    known.sought_again = numbers[3] != 0.0;
    known.orbit.time = numbers[4];
    for (Index i = 5; i < numbers.size(); ++i)
        known.orbit.rotation.push_back(static_cast<int>(numbers[i]));
    known.place = part[1];
    known.scale = part[2];
    if (known.scale.size() > 0) known.orbit.points = part[3].reshaped(part[2].size(), part[3].size() / part[2].size());
    if (part[3].size() > 0)
        known.orbit.sensitivities = part[4].reshaped(part[3].size(), part[4].size() / part[3].size());
    known.orbit.time_sensitivities = part[5].transpose();
    known.origin = {part[6], part[7]};
    known.offsets = part[8];
    if (part[9].size() > 0) {
        known.orbit.parameter = part[9](0);
        known.orbit.parameter_sensitivities = part[9].tail(part[9].size() - 1).transpose();
    }
    return known;
}

void SteadyStateResidual::remember(estimator::ActiveSet& active, std::size_t block, const Known& known) const {
    VectorXd* part = &active.memory[memory_parts * block];
    VectorXd& numbers = part[0];
    numbers.resize(5 + std::ssize(known.orbit.rotation));
    numbers.head<5>() << static_cast<double>(known.status), known.phase, known.taken_back,
        known.sought_again ? 1.0 : 0.0, known.orbit.time;
    for (std::size_t i = 0; i < known.orbit.rotation.size(); ++i)
        numbers[static_cast<Index>(i) + 5] = known.orbit.rotation[i];
    part[1] = known.place;
    part[2] = known.scale;
    part[3] = known.orbit.points.reshaped();
    part[4] = known.orbit.sensitivities.reshaped();
    part[5] = known.orbit.time_sensitivities.transpose();
    part[6] = known.origin.point;
    part[7] = known.origin.normal;
    part[8] = known.offsets;
    part[9].resize(1 + known.orbit.parameter_sensitivities.size());
    part[9] << known.orbit.parameter, known.orbit.parameter_sensitivities.transpose();
    active.latents[block] = starting_latents(block, known);
}

}  // namespace orbid::periodic
