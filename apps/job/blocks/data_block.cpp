#include <algorithm>
#include <functional>
#include <numeric>

#include "apps/job/blocks/block_fields.hpp"
#include "apps/job/blocks/job_schema.hpp"
#include "apps/job/data_job.hpp"

namespace orbid::apps {

namespace describe {

namespace {

using Json = nlohmann::ordered_json;

/// Labels of segments: texts, or numbers as they stand in the file.
std::vector<std::string> read_labels(const ValueReader& value) {
    std::vector<std::string> result;
    for (const ValueReader& item : value.items()) {
        if (item.is(JsonValue::Kind::number)) result.push_back(fmt::format("{}", item.value().number));
        if (item.is(JsonValue::Kind::string)) result.push_back(item.value().text);
    }
    return result;
}

void read_fitted(const ValueReader& value, const Job&, DataJob& data) {
    if (value.is(JsonValue::Kind::string)) return;
    data.fit = read_labels(value);
    for (const std::string& label : *data.fit)
        if (is_in(label, data.predict)) value.report(fmt::format("segment {} stands in \"predict\" too", label));
}

const FieldTable<DataJob>& segment_fields() {
    static const FieldTable<DataJob> table{
        Field<DataJob>{
            key("fit", choice({"all"}) | set(text() | number(), 1), "Segments that are fitted.").by_default("all"),
            read_fitted, [](const DataJob& data, const Writing&) { return data.fit ? Json(*data.fit) : Json("all"); }}
            .read_after("predict"),
        {key("predict", set(text() | number()), "Segments that are predicted, not fitted.").standard_text("[]"),
         [](const ValueReader& value, const Job&, DataJob& data) { data.predict = read_labels(value); },
         [](const DataJob& data, const Writing&) -> Json { return data.predict; }}};
    return table;
}

std::vector<Eigen::Index> readable_coordinates(const Job& job, const DataJob& data) {
    std::vector<Eigen::Index> coordinates(coordinate_names(job).size());
    std::iota(coordinates.begin(), coordinates.end(), Eigen::Index{0});
    if (!data.file || !data.file->table) return coordinates;
    coordinates.clear();
    for (const ColumnJob& column : data.file->columns)
        coordinates.push_back(column.coordinate);
    return coordinates;
}

void read_observe(const ValueReader& value, const Job& job, DataJob& data) {
    const auto readable = std::exchange(data.observe, {});
    for (const auto& [name, item] : read_names(value)) {
        const auto index = coordinate_named(name, item, job);
        if (!index) continue;
        if (std::find(readable.begin(), readable.end(), *index) == readable.end())
            item.report(fmt::format("\"{}\" is observed, but \"columns\" names no column for it", name));
        data.observe.push_back(*index);
    }
    std::sort(data.observe.begin(), data.observe.end());
}

void read_own_parameters(const ValueReader& value, const Job& job, DataJob& data) {
    for (const auto& [name, item] : read_names(value))
        if (const auto index = parameter_named(name, item, job)) data.free.push_back(*index);
    std::sort(data.free.begin(), data.free.end());
}

Json own_values_document(const DataJob& data, const Writing& at) {
    Json object = Json::object();
    for (const ParameterValue& entry : data.parameters)
        object[parameter_name(at.job, entry.parameter)] = entry.value;
    return object;
}

FieldTable<DataJob> make_data_fields() {
    FieldTable<DataJob> table{
        open_field(key("name", name(), "Of the experiment; run1, run2, ... unless given."), &DataJob::name),
        simulation_field()};
    add_file_fields(table);
    const FieldTable<DataJob> rest{
        sensor_field(),
        {key("observe", names(1), "Coordinates that are data; unless given all that have a column."),
         read_later<DataJob>,
         [](const DataJob& data, const Writing& at) { return coordinate_list(at.job, data.observe); }},
        {key("parameters", entries(number(), "a parameter of the model"), "Values that hold for this experiment only.")
             .standard_text("{}"),
         [](const ValueReader& value, const Job& job, DataJob& data) {
             data.parameters = read_parameter_values(value, job);
         },
         own_values_document},
        {key("free", names(), "Parameters that are estimated for this experiment alone, as NAME@EXPERIMENT.")
             .standard_text("[]"),
         read_own_parameters, [](const DataJob& data, const Writing& at) { return parameter_list(at.job, data.free); }},
        object_field<DataJob>(key("segments", {}, "Which segments are fitted, and which predicted."), segment_fields(),
                              std::identity()),
        initial_state_field()};
    table.insert(table.end(), rest.begin(), rest.end());
    return table;
}

}  // namespace

const FieldTable<DataJob>& data_fields() {
    static const FieldTable<DataJob> table = make_data_fields();
    return table;
}

ValueSchema data_block() {
    return named("experiment", object(keys_of(data_fields()), {"simulate", "file", "files"}));
}

}  // namespace describe

namespace {

/// The difference of two readings has the error of the angle, none of its own.
void check_noise_of_difference(const ObjectReader& object, const Job& job, const DataJob& data) {
    if (!data.simulation || data.sensor.type != models::Sensor::Type::angle_difference || !job.model.system) return;
    if (data.simulation->noise[static_cast<Eigen::Index>(data.sensor.rate)] != 0.0)
        object.report("simulate", "noise of a rate that is a difference of readings must be 0: give the angle's");
    if (data.simulation->noise_correlation[static_cast<Eigen::Index>(data.sensor.angle)] != 0.0)
        object.report("simulate",
                      "noise of an angle that is read twice for a difference cannot be correlated in this version");
}

/// Nothing of a stream is left out, and nothing of it is fitted.
void check_stream(const ObjectReader& object, const DataJob& data) {
    const orbits::RecordPart whole, &part = data.file->part;
    const auto refuse_if = [&](bool asked, const char* key) {
        if (asked) object.report(key, "does not go with \"stream\": all of a stream is read, for cycles only");
    };
    refuse_if(part.first_row != whole.first_row || part.last_row != whole.last_row, "rows");
    refuse_if(part.windowed(), "window");
    refuse_if(data.fit || !data.predict.empty(), "segments");
}

DataJob read_experiment(const ValueReader& value, const std::string& default_name, const Job& job) {
    DataJob data;
    data.name = default_name;
    data.initial_state.resize(coordinate_names(job).size());
    // Where neither source is there, which is reported, the rest finds a simulation without noise.
    data.simulation = describe::simulation_without_noise(job);
    ObjectReader object(value);
    read_fields(object, describe::data_fields(), data, job);
    if (data.file && data.file->table && !object.find("columns")) describe::take_default_columns(job, *data.file);
    if (data.file && data.file->table && data.file->part.windowed() && data.file->time_column.empty() &&
        data.file->step == 0.0)
        object.report("window", "needs the times of the record: name their column in \"columns\", or use \"rows\"");
    if (data.streamed()) check_stream(object, data);
    data.observe = describe::readable_coordinates(job, data);
    if (const auto observe = object.find("observe")) describe::read_observe(*observe, job, data);
    const auto inputs = job.model.system ? job.model.system->inputs() : std::span<const models::Coordinate>{};
    if (!inputs.empty() && object.valid() && !object.find("inputs"))
        value.report(fmt::format("the model {} reads measured inputs ({}): \"inputs\" is missing", job.model.name,
                                 fmt::join(names_of(inputs), ", ")));
    if (job.model.system && inputs.empty()) data.inputs.reset();  // they have been refused
    check_noise_of_difference(object, job, data);
    object.finish();
    return data;
}

}  // namespace

void read_data(ObjectReader& root, Job& job) {
    const auto value = root.find("data");
    if (!value) return;
    std::vector<ValueReader> experiments;
    if (value->is(JsonValue::Kind::object))
        experiments.push_back(*value);
    else
        experiments = value->items();
    for (std::size_t i = 0; i < experiments.size(); ++i) {
        DataJob data = read_experiment(experiments[i], fmt::format("run{}", i + 1), job);
        const bool twice = std::any_of(job.data.begin(), job.data.end(),
                                       [&](const DataJob& other) { return other.name == data.name; });
        if (twice) experiments[i].report(fmt::format("there are two experiments named \"{}\"", data.name));
        job.data.push_back(std::move(data));
    }
}

}  // namespace orbid::apps
