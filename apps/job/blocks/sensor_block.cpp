#include <algorithm>
#include <regex>

#include "apps/job/blocks/block_fields.hpp"
#include "apps/job/blocks/job_schema.hpp"
#include "apps/job/data_job.hpp"

namespace orbid::apps {

namespace describe {

namespace {

using models::Sensor;

void read_readings(const ValueReader& value, const Job& job, Sensor& sensor) {
    for (const auto& [name, member] : value.members()) {
        const auto coordinate = coordinate_named(name, member, job);
        const auto text = member.text();
        if (!coordinate || !text) continue;
        try {
            const models::System& system = *job.model.system;
            const auto names = models::reading_names(system.coordinates(), system.parameters(), system.inputs());
            sensor.functions.push_back(
                {static_cast<std::size_t>(*coordinate), models::Expression::parse(*text, names)});
        } catch (const models::ExpressionError& error) {
            member.report_character(error.position, error.what());
        }
    }
    std::sort(sensor.functions.begin(), sensor.functions.end(),
              [](const auto& a, const auto& b) { return a.coordinate < b.coordinate; });
}

nlohmann::ordered_json readings_document(const Sensor& sensor, const Writing& at) {
    auto readings = nlohmann::ordered_json::object();
    for (const models::FunctionReading& reading : sensor.functions)
        readings[coordinate_name(at.job, static_cast<Eigen::Index>(reading.coordinate))] = reading.expression.text();
    return readings;
}

bool has_encoder(const Sensor& sensor) {
    return sensor.type == Sensor::Type::angle_difference || sensor.step != 0.0;
}

const FieldTable<Sensor>& sensor_fields() {
    using Type = Sensor::Type;
    const std::vector<std::string> difference{"angle_difference"};
    static const FieldTable<Sensor> table{
        word_field(
            key("type", {},
                "\"state\" reads the state as it is, \"function\" formulas of it, \"angle_difference\" a rate as "
                "the difference of two readings of an angle.")
                .required_always(),
            {{Type::state, "state"}, {Type::function, "function"}, {Type::angle_difference, "angle_difference"}},
            &Sensor::type),
        {key("readings", entries(text(), "a coordinate", {}, 1), "Formulas: { \"x\": \"x^2 + y\" }.")
             .with("type", {"function"})
             .required_always(),
         read_readings, readings_document},
        coordinate_field(key("angle", text(), "The coordinate that an encoder reads.").needed_with("type", difference),
                         &Sensor::angle)
            .written_if(has_encoder),
        coordinate_field(key("rate", text(), "The coordinate that the difference quotient stands for.")
                             .with("type", difference)
                             .required_always(),
                         &Sensor::rate),
        open_field(key("delay", above(0.0), "Between the two readings of the angle.")
                       .in("s")
                       .with("type", difference)
                       .required_always(),
                   &Sensor::delay),
        field(key("step", at_least(0.0), "Of the encoder, in the unit of the angle."), &Sensor::step)
            .written_if(has_encoder),
        choice_field(key("rounding", {}, "Readings are whole steps; needs a step > 0."), rounding_names,
                     &Sensor::rounding)
            .with_rule([](const ValueReader& value, const Job&, Sensor& sensor) {
                if (sensor.rounding == Sensor::Rounding::nearest && !(sensor.step > 0))
                    value.report("rounding needs the encoder's \"step\" > 0");
            })
            .written_if(has_encoder)};
    return table;
}

void read_sensor(const ValueReader& value, const Job& job, DataJob& data) {
    Sensor& sensor = data.sensor;
    ObjectReader object(value);
    const auto type = object.find("type");
    // Without a known type every other key would be called unknown.
    if (!type || type->refused()) return;
    read_fields(object, sensor_fields(), sensor, job);
    const bool difference = sensor.type == Sensor::Type::angle_difference;
    // An encoder beside a state or formulas has all its keys or none.
    if (!difference && !object.find("angle") && (object.find("step") || object.find("rounding")))
        (void)object.require("angle", "the coordinate that is read");
    const auto names_coordinate = [&](std::string_view word) {
        const auto entry = object.find(word);
        return entry && entry->is(JsonValue::Kind::string) && is_in(entry->value().text, coordinate_names(job));
    };
    if (names_coordinate("angle")) {
        const models::Coordinate& entry = job.model.system->coordinates()[sensor.angle];
        if (!entry.angle) object.report("angle", fmt::format("{} is no angle", entry.name));
        if (names_coordinate("rate") && sensor.angle == sensor.rate)
            object.report("rate", "must be another coordinate than the angle");
    }
    object.finish();
}

}  // namespace

Field<DataJob> sensor_field() {
    return {key("sensor", object(keys_of(sensor_fields())), "What the instrument reads.")
                .standard_text(R"({ "type": "state" })"),
            read_sensor,
            [](const DataJob& data, const Writing& at) { return fields_document(data.sensor, sensor_fields(), at); }};
}

}  // namespace describe

namespace {

JsonValue member_of_value(const JsonValue& object, std::string_view key) {
    const auto at = std::find_if(object.members.begin(), object.members.end(),
                                 [key](const JsonMember& one) { return one.key == key; });
    return at == object.members.end() ? JsonValue() : at->value;
}

void add_names_of(const JsonValue& readings, std::vector<std::string>& names) {
    for (const JsonMember& reading : readings.members) {
        const JsonValue formula = member_of_value(reading.value, "formula");
        const std::string& text = reading.value.text.empty() ? formula.text : reading.value.text;
        const std::regex name("[A-Za-z_][A-Za-z0-9_]*");
        for (std::sregex_iterator at(text.begin(), text.end(), name), end; at != end; ++at)
            names.push_back(at->str());
    }
}

}  // namespace

std::vector<std::string> names_in_data(const JsonValue& data) {
    std::vector<std::string> names;
    const auto add = [&](const JsonValue& experiment) {
        if (const JsonValue delay = member_of_value(experiment, "delay"); delay.kind == JsonValue::Kind::string)
            names.push_back(delay.text);
        add_names_of(member_of_value(member_of_value(experiment, "sensor"), "readings"), names);
    };
    if (data.kind == JsonValue::Kind::object) add(data);
    std::for_each(data.items.begin(), data.items.end(), add);
    return names;
}

std::vector<std::string> names_in_residuals(const JsonValue& estimate) {
    std::vector<std::string> names;
    for (const JsonValue& residual : member_of_value(estimate, "residuals").items)
        add_names_of(member_of_value(residual, "readings"), names);
    return names;
}

bool reads_angle(const Job& job, const std::vector<std::size_t>& data, Eigen::Index coordinate) {
    const auto coordinates = job.model.system->coordinates();
    const auto index = static_cast<std::size_t>(coordinate);
    if (data.empty()) return coordinates[index].angle;
    return std::any_of(data.begin(), data.end(), [&](std::size_t experiment) {
        const DataJob& data_job = job.data[experiment];
        return data_job.observes(coordinate) && models::reads_angle(data_job.sensor, coordinates, index);
    });
}

}  // namespace orbid::apps
