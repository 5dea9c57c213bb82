#include "apps/documents/json_text.hpp"
#include "apps/job/blocks/block_fields.hpp"
#include "apps/job/writing/job_writer.hpp"

namespace orbid::apps::detail {

namespace {

using Json = nlohmann::ordered_json;
using Sampling = orbits::Series::Sampling;

Json simulation_document(const Job& job, const SimulationJob& simulation) {
    Json object = Json::object();
    if (simulation.sampling == Sampling::section) {
        object["sections"] = simulation.sections;
    } else {
        object["samples"] = fields_document(simulation, describe::samples_fields());
    }
    object["trajectories"] = simulation.trajectories;
    object["transient"] = simulation.transient;
    object["initial"] = simulation.initial.empty()
                            ? Json("random")
                            : json_list(simulation.initial, [](const auto& state) { return json_list(state); });
    object["restart"] = simulation.restart ? "when_captured_or_at_rest" : "never";
    object["noise"] = Json::object();
    for (Eigen::Index i = 0; i < simulation.noise.size(); ++i) {
        const Json sd = simulation.noise[i];
        const double correlation = simulation.noise_correlation[i];
        object["noise"][coordinate_name(job, i)] =
            correlation == 0.0 ? sd : Json{{"sd", sd}, {"correlation", correlation}};
    }
    return object;
}

void add_file(const Job& job, const FileJob& file, const std::filesystem::path& folder, Json& object) {
    object["file"] = path_text(file.path, folder);
    if (!file.sha256.empty()) object["sha256"] = file.sha256;
    object["kind"] = name_of(file.sampling, sampling_names);
    if (file.table) {
        Json columns = Json::object();
        if (!file.segment_column.empty()) columns["segment"] = file.segment_column;
        if (!file.time_column.empty()) columns["time"] = {{"column", file.time_column}, {"unit", file.time_unit}};
        for (const ColumnJob& column : file.columns)
            columns[coordinate_name(job, column.coordinate)] = fields_document(column, describe::column_fields());
        object["columns"] = std::move(columns);
    }
    object["missing"] = file.nan_is_missing ? "nan" : "empty";
}

void add_inputs(const Job& job, const InputJob& input, const std::filesystem::path& folder, Json& object) {
    Json inputs = Json::object();
    if (input.file) {
        inputs["file"] = path_text(*input.file, folder);
        if (!input.sha256.empty()) inputs["sha256"] = input.sha256;
        inputs["time"] = {{"column", input.time_column}, {"unit", input.time_unit}};
    }
    for (const ColumnJob& column : input.columns) {
        const auto& entry = job.model.system->inputs()[static_cast<std::size_t>(column.coordinate)];
        inputs[std::string(entry.name)] = fields_document(column, describe::column_fields());
    }
    object["inputs"] = std::move(inputs);
    object["interpolation"] = name_of(input.interpolation, interpolation_names);
}

Json sensor_document(const Job& job, const models::Sensor& sensor) {
    using Type = models::Sensor::Type;
    Json object{{"type", sensor.type == Type::state      ? "state"
                         : sensor.type == Type::function ? "function"
                                                         : "angle_difference"}};
    for (const models::FunctionReading& reading : sensor.functions)
        object["readings"][coordinate_name(job, static_cast<Eigen::Index>(reading.coordinate))] =
            reading.expression.text();
    const bool difference = sensor.type == Type::angle_difference;
    if (!difference && sensor.step == 0.0) return object;
    object["angle"] = coordinate_name(job, static_cast<Eigen::Index>(sensor.angle));
    if (difference) {
        object["rate"] = coordinate_name(job, static_cast<Eigen::Index>(sensor.rate));
        object["delay"] = sensor.delay;
    }
    object["step"] = sensor.step;
    object["rounding"] = name_of(sensor.rounding, rounding_names);
    return object;
}

Json initial_value_document(const InitialValueJob& initial) {
    if (!initial.estimate) return {{"value", initial.value.value()}};
    Json object = Json::object();
    if (initial.value) object["start"] = *initial.value;
    object["prior"] = prior_document(initial.prior);
    if (!initial.is_parameter()) return object;
    object["scale"] = name_of(initial.scale, scale_names);
    object["bounds"] = bounds_document(initial.lower, initial.upper);
    return object;
}

}  // namespace

Json data_document(const Job& job, const DataJob& data, const std::filesystem::path& folder) {
    Json object{{"name", data.name}};
    if (data.simulation) object["simulate"] = simulation_document(job, *data.simulation);
    if (data.file) add_file(job, *data.file, folder, object);
    if (data.inputs) add_inputs(job, *data.inputs, folder, object);
    object["sensor"] = sensor_document(job, data.sensor);
    object["observe"] = coordinate_list(job, data.observe);
    object["parameters"] = Json::object();
    for (const ParameterValue& entry : data.parameters)
        object["parameters"][parameter_name(job, entry.parameter)] = entry.value;
    object["free"] = parameter_list(job, data.free);
    object["segments"]["fit"] = data.fit ? Json(*data.fit) : Json("all");
    object["segments"]["predict"] = data.predict;
    if (data.sampling() == Sampling::samples) {
        for (std::size_t i = 0; i < data.initial_state.size(); ++i)
            object["initial_state"][coordinate_name(job, static_cast<Eigen::Index>(i))] =
                initial_value_document(data.initial_state[i]);
    }
    return object;
}

}  // namespace orbid::apps::detail
