#include <cmath>

#include "apps/job/job_parts.hpp"

namespace orbid::apps {

namespace {

using Sampling = orbits::Series::Sampling;

bool has_kind(const Job& job, models::Kind kind) {
    return job.model.system && job.model.system->kind() == kind;
}

void read_samples(const ValueReader& value, SimulationJob& simulation) {
    simulation.sampling = Sampling::samples;
    ObjectReader samples(value);
    if (const auto step = samples.find("step")) simulation.step = step->number().value_or(1.0);
    if (const auto count = samples.find("count")) simulation.count = count->whole().value_or(2);
    samples.finish();
}

void read_initial_states(const ValueReader& value, const Job& job, bool trajectories_given, SimulationJob& simulation) {
    if (value.is(JsonValue::Kind::string)) {
        (void)value.choice({"random"});
        return;
    }
    if (value.refused()) return;
    for (const ValueReader& item : value.items())
        if (const auto state = read_state(item, job)) simulation.initial.push_back(*state);
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
            if (const auto value = entry.find("sd")) sd = value->number();
            if (const auto value = entry.find("correlation")) correlation = value->number().value_or(0.0);
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
    const auto trajectories = object.find("trajectories");
    if (trajectories) simulation.trajectories = trajectories->whole().value_or(1);
    if (samples) {
        if (has_kind(job, models::Kind::map))
            samples->report(
                fmt::format("the model {} is a map: it has no samples in time; use \"sections\"", job.model.name));
        read_samples(*samples, simulation);
    } else if (sections) {
        if (has_kind(job, models::Kind::autonomous) && !job.section_plane)
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
    if (const auto transient = object.find("transient")) {
        simulation.transient = transient->whole().value_or(0);
    } else if (simulation.initial.empty() && simulation.sampling == Sampling::section) {
        simulation.transient = SimulationJob::transient_of_random_sections;
    }
    if (const auto restart = object.find("restart"))
        simulation.restart = restart->choice({"when_captured_or_at_rest", "never"}) != 1;
    read_noise(object, job, simulation);
    object.finish();
    return simulation;
}

}  // namespace orbid::apps
