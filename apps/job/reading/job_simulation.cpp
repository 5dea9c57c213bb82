#include "apps/job/blocks/block_fields.hpp"
#include "apps/job/job_parts.hpp"

namespace orbid::apps {

namespace {

using Sampling = orbits::Series::Sampling;

void read_samples(const ValueReader& value, SimulationJob& simulation) {
    simulation.sampling = Sampling::samples;
    ObjectReader samples(value);
    read_fields(samples, describe::samples_fields(), simulation);
    samples.finish();
}

void read_initial_states(const ValueReader& value, const Job& job, bool trajectories_given, SimulationJob& simulation) {
    if (value.is(JsonValue::Kind::string)) {
        (void)value.choice({"random"});
        return;
    }
    if (value.refused()) return;
    simulation.initial = read_states(value, job);
    const std::size_t states = value.value().items.size();
    if (!trajectories_given) {
        simulation.trajectories = states;
    } else if (states != simulation.trajectories) {
        value.report(fmt::format("must hold one state per trajectory: {}, not {}", simulation.trajectories, states));
    }
}

/// "noise": { "x": sd, "y": { "sd": ..., "correlation": ... } }; the latter is a first-order autoregression from
/// reading to reading.
void read_noise(ObjectReader& object, const Job& job, SimulationJob& simulation) {
    const auto noise = object.find("noise");
    if (!noise) return;
    for (const auto& [name, member] : noise->members()) {
        std::optional<double> sd;
        double correlation = 0.0;
        if (member.is(JsonValue::Kind::object)) {
            ObjectReader entry(member);
            entry.read("sd", sd);
            entry.read("correlation", correlation);
            entry.finish();
        } else if (member.is(JsonValue::Kind::number)) {
            sd = member.number();
        }
        const auto index = coordinate_named(name, member, job);
        if (!sd || !index) continue;
        simulation.noise[*index] = *sd;
        simulation.noise_correlation[*index] = correlation;
    }
}

}  // namespace

SimulationJob simulation_without_noise(const Job& job) {
    SimulationJob simulation;
    simulation.noise = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(coordinate_names(job).size()));
    simulation.noise_correlation = simulation.noise;
    return simulation;
}

SimulationJob read_simulation(const ValueReader& value, const Job& job) {
    SimulationJob simulation = simulation_without_noise(job);
    ObjectReader object(value);
    const auto sections = object.find("sections");
    const auto samples = object.find("samples");
    const auto trajectories = object.read("trajectories", simulation.trajectories);
    if (samples) {
        if (job.model.is(models::Kind::map))
            samples->report(
                fmt::format("the model {} is a map: it has no samples in time; use \"sections\"", job.model.name));
        read_samples(*samples, simulation);
    } else if (sections) {
        if (job.model.is(models::Kind::autonomous) && !job.section_plane)
            sections->report(
                fmt::format("the model {} is not forced: name the section beside \"data\", \"section\": "
                            "{{ \"coordinate\": ..., \"value\": ..., \"direction\": 1 }}",
                            job.model.name));
        const auto number =
            sections->number([&](double x) { return x >= static_cast<double>(simulation.trajectories); },
                             fmt::format("at least one per trajectory: {}", simulation.trajectories));
        simulation.sections = number ? static_cast<std::size_t>(*number) : simulation.trajectories;
    }
    if (const auto initial = object.find("initial"))
        read_initial_states(*initial, job, trajectories.has_value(), simulation);
    if (!object.read("transient", simulation.transient) && simulation.initial.empty() &&
        simulation.sampling == Sampling::section)
        simulation.transient = SimulationJob::transient_of_random_sections;
    if (const auto restart = object.find("restart"))
        simulation.restart = restart->choice({"when_captured_or_at_rest", "never"}) != 1;
    read_noise(object, job, simulation);
    object.finish();
    return simulation;
}

}  // namespace orbid::apps
