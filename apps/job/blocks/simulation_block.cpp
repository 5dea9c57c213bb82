#include <functional>

#include "apps/documents/json_text.hpp"
#include "apps/job/blocks/block_fields.hpp"
#include "apps/job/blocks/job_schema.hpp"
#include "apps/job/data_job.hpp"

namespace orbid::apps::describe {

namespace {

using Json = nlohmann::ordered_json;
using Sampling = orbits::Series::Sampling;

constexpr double most_simulated_trajectories = 1e6;

/// Noise of one coordinate: a first-order autoregression from reading to reading.
struct ReadingNoise {
    std::optional<double> sd;
    double correlation = 0.0;
};

const FieldTable<ReadingNoise>& reading_noise_fields() {
    static const FieldTable<ReadingNoise> table{
        open_field(key("sd", at_least(0.0), "Standard deviation of a reading.").required_always(), &ReadingNoise::sd),
        field(key("correlation", between(-1.0, 1.0), "From one reading to the next."), &ReadingNoise::correlation)};
    return table;
}

/// { "x": sd, "y": { "sd": ..., "correlation": ... } }
void read_noise(const ValueReader& value, const Job& job, SimulationJob& simulation) {
    for (const auto& [name, member] : value.members()) {
        ReadingNoise noise;
        read_short_or_object(member, "sd", reading_noise_fields(), noise);
        const auto index = coordinate_named(name, member, job);
        if (!noise.sd || !index) continue;
        simulation.noise[*index] = *noise.sd;
        simulation.noise_correlation[*index] = noise.correlation;
    }
}

Json noise_document(const SimulationJob& simulation, const Writing& at) {
    Json object = Json::object();
    for (Eigen::Index i = 0; i < simulation.noise.size(); ++i) {
        const ReadingNoise noise{simulation.noise[i], simulation.noise_correlation[i]};
        object[coordinate_name(at.job, i)] =
            noise.correlation == 0.0 ? Json(*noise.sd) : fields_document(noise, reading_noise_fields());
    }
    return object;
}

const FieldTable<SimulationJob>& samples_fields() {
    static const FieldTable<SimulationJob> table{
        open_field(key("step", above(0.0), "Between two samples.").in("s").required_always(), &SimulationJob::step),
        open_field(
            key("count", whole(2, most_simulated_points), "Number of samples of a trajectory.").required_always(),
            &SimulationJob::count)};
    return table;
}

void read_sections(const ValueReader& value, const Job& job, SimulationJob& simulation) {
    if (simulation.sampling == Sampling::samples) return;
    if (job.model.is(models::Kind::autonomous) && !job.section_plane)
        value.report(
            fmt::format("the model {} is not forced: name the section beside \"data\", \"section\": "
                        "{{ \"coordinate\": ..., \"value\": ..., \"direction\": 1 }}",
                        job.model.name));
    const auto number = value.number([&](double x) { return x >= static_cast<double>(simulation.trajectories); },
                                     fmt::format("at least one per trajectory: {}", simulation.trajectories));
    simulation.sections = number ? static_cast<std::size_t>(*number) : simulation.trajectories;
}

void check_samples(const ValueReader& value, const Job& job, SimulationJob& simulation) {
    simulation.sampling = Sampling::samples;
    if (job.model.is(models::Kind::map))
        value.report(fmt::format("the model {} is a map: it has no samples in time; use \"sections\"", job.model.name));
}

void read_initial_states(const ValueReader& value, const Job& job, bool trajectories_given, SimulationJob& simulation) {
    if (value.refused() || value.is(JsonValue::Kind::string)) return;
    simulation.initial = read_states(value, job);
    const std::size_t states = value.value().items.size();
    if (!trajectories_given) {
        simulation.trajectories = states;
    } else if (states != simulation.trajectories) {
        value.report(fmt::format("must hold one state per trajectory: {}, not {}", simulation.trajectories, states));
    }
}

Json initial_document(const SimulationJob& simulation, const Writing&) {
    if (simulation.initial.empty()) return "random";
    return json_list(simulation.initial, [](const auto& state) { return json_list(state); });
}

const FieldTable<SimulationJob>& simulation_fields() {
    const auto is = [](Sampling sampling) {
        return [sampling](const SimulationJob& simulation) { return simulation.sampling == sampling; };
    };
    static const FieldTable<SimulationJob> table{
        Field<SimulationJob>{
            key("sections", whole(1, most_simulated_points),
                "Points of the section of all trajectories together; iterates of a map."),
            read_sections, [](const SimulationJob& simulation, const Writing&) -> Json { return simulation.sections; }}
            .read_after("trajectories")
            .written_if(is(Sampling::section)),
        object_field<SimulationJob>(key("samples", {}, "Samples in time in the place of sections."), samples_fields(),
                                    std::identity())
            .with_rule(check_samples)
            .written_if(is(Sampling::samples)),
        field(key("trajectories", whole(1, most_simulated_trajectories), "One segment each."),
              &SimulationJob::trajectories),
        open_field(key("transient", whole(0, most_simulated_points),
                       "Thrown away before the first point: periods, or steps of samples; 300 for sections from random "
                       "states, else 0."),
                   &SimulationJob::transient),
        {key("initial", choice({"random"}) | list(state(), 1), "States to begin at, one per trajectory.")
             .by_default("random"),
         read_later<SimulationJob>, initial_document},
        word_field(
            key("restart", {}, "A trajectory that comes to rest or to a stable orbit is begun anew, or only reported."),
            {{true, "when_captured_or_at_rest"}, {false, "never"}}, &SimulationJob::restart),
        {key("noise", entries(at_least(0.0) | object(keys_of(reading_noise_fields())), "a coordinate of the model"),
             "Standard deviation of a reading, in the coordinate's unit.")
             .standard_text("{}"),
         read_noise, noise_document}};
    return table;
}

void read_simulation(const ValueReader& value, const Job& job, DataJob& data) {
    // Beside a file it has been refused.
    if (data.file) return;
    SimulationJob& simulation = data.simulation.emplace(simulation_without_noise(job));
    ObjectReader object(value);
    read_fields(object, simulation_fields(), simulation, job);
    if (const auto initial = object.find("initial"))
        read_initial_states(*initial, job, object.find("trajectories").has_value(), simulation);
    if (!object.find("transient") && simulation.initial.empty() && simulation.sampling == Sampling::section)
        simulation.transient = SimulationJob::transient_of_random_sections;
    object.finish();
}

}  // namespace

SimulationJob simulation_without_noise(const Job& job) {
    SimulationJob simulation;
    simulation.noise = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(coordinate_names(job).size()));
    simulation.noise_correlation = simulation.noise;
    return simulation;
}

Field<DataJob> simulation_field() {
    return Field<DataJob>{key("simulate", object(keys_of(simulation_fields()), {"sections", "samples"}),
                              "Data made by the model at the job's parameters."),
                          read_simulation,
                          [](const DataJob& data, const Writing& at) {
                              return data.simulation ? fields_document(*data.simulation, simulation_fields(), at)
                                                     : left_out();
                          }}
        .read_after("file");
}

}  // namespace orbid::apps::describe
