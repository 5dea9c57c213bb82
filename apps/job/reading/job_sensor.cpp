#include <algorithm>
#include <regex>

#include "apps/job/job_parts.hpp"

namespace orbid::apps {

namespace {

using Type = models::Sensor::Type;

/// The coordinate that a key names.
std::optional<std::size_t> read_coordinate(ObjectReader& object, std::string_view key, const Job& job) {
    const auto entry = object.find(key);
    const auto name = entry ? entry->text() : std::nullopt;
    const auto index = name ? coordinate_named(*name, *entry, job) : std::nullopt;
    if (!index) return std::nullopt;
    return static_cast<std::size_t>(*index);
}

/// "angle", and the step of its encoder.
std::optional<std::size_t> read_encoder(ObjectReader& object, const Job& job, models::Sensor& sensor) {
    const auto angle = read_coordinate(object, "angle", job);
    if (angle) {
        sensor.angle = *angle;
        const models::Coordinate& entry = job.model.system->coordinates()[*angle];
        if (!entry.angle) object.report("angle", fmt::format("{} is no angle", entry.name));
    }
    object.read("step", sensor.step);
    const auto rounding = object.choose("rounding", rounding_names, sensor.rounding);
    if (sensor.rounding == models::Sensor::Rounding::nearest && !(sensor.step > 0))
        rounding->report("rounding needs the encoder's \"step\" > 0");
    return angle;
}

/// An encoder beside a state or formulas: all its keys or none.
void read_optional_encoder(ObjectReader& object, const Job& job, models::Sensor& sensor) {
    const bool has_angle = object.find("angle").has_value();
    const bool named = has_angle || object.find("step") || object.find("rounding");
    if (!named) return;
    if (!has_angle) (void)object.require("angle", "the coordinate that is read");
    (void)read_encoder(object, job, sensor);
}

void read_difference(ObjectReader& object, const Job& job, models::Sensor& sensor) {
    const auto angle = read_encoder(object, job, sensor);
    const auto rate = read_coordinate(object, "rate", job);
    if (rate) sensor.rate = *rate;
    if (angle && rate && *angle == *rate) object.report("rate", "must be another coordinate than the angle");
    object.read("delay", sensor.delay);
}

void read_functions(ObjectReader& object, const Job& job, models::Sensor& sensor) {
    const auto readings = object.find("readings");
    if (!readings) return;
    for (const auto& [name, member] : readings->members()) {
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

}  // namespace

std::vector<std::string> names_in_sensors(const JsonValue& data) {
    const auto member = [](const JsonValue& object, std::string_view key) {
        const auto at = std::find_if(object.members.begin(), object.members.end(),
                                     [key](const JsonMember& one) { return one.key == key; });
        return at == object.members.end() ? JsonValue() : at->value;
    };
    std::vector<std::string> names;
    const auto add = [&](const JsonValue& experiment) {
        for (const JsonMember& reading : member(member(experiment, "sensor"), "readings").members) {
            const std::string& text = reading.value.text;
            const std::regex name("[A-Za-z_][A-Za-z0-9_]*");
            for (std::sregex_iterator at(text.begin(), text.end(), name), end; at != end; ++at)
                names.push_back(at->str());
        }
    };
    if (data.kind == JsonValue::Kind::object) add(data);
    std::for_each(data.items.begin(), data.items.end(), add);
    return names;
}

models::Sensor read_sensor(const ValueReader& value, const Job& job) {
    models::Sensor sensor;
    ObjectReader object(value);
    const auto type = object.find("type");
    const auto choice = type ? type->choice({"state", "function", "angle_difference"}) : std::nullopt;
    // Without a known type every other key would be called unknown.
    if (!choice) return sensor;
    if (*choice == 2) {
        sensor.type = Type::angle_difference;
        read_difference(object, job, sensor);
    } else {
        if (*choice == 1) {
            sensor.type = Type::function;
            read_functions(object, job, sensor);
        }
        read_optional_encoder(object, job, sensor);
    }
    object.finish();
    return sensor;
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
