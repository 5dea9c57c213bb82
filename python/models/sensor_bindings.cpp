#include "models/definition/sensor.hpp"

#include <algorithm>
#include <optional>

#include "python/conversion/arguments.hpp"
#include "python/conversion/named_arguments.hpp"
#include "python/orbits/series_bindings.hpp"

namespace orbid::python {

namespace py = pybind11;

namespace {

using models::Sensor;

std::optional<std::size_t> coordinate(NamedArguments& given, const char* name, const models::System& system) {
    if (!given.has(name)) return std::nullopt;
    return static_cast<std::size_t>(index_of(given.text(name, ""), coordinate_names(system), "coordinate"));
}

std::size_t required_coordinate(NamedArguments& given, const char* name, const models::System& system) {
    const auto found = coordinate(given, name, system);
    if (!found) throw py::type_error("sensor: '" + std::string(name) + "' is missing");
    return *found;
}

/// "angle", and the step of its encoder.
void read_encoder(NamedArguments& given, const models::System& system, Sensor& sensor) {
    sensor.angle = required_coordinate(given, "angle", system);
    const models::Coordinate& angle = system.coordinates()[sensor.angle];
    if (!angle.angle) throw py::value_error("sensor: angle: " + std::string(angle.name) + " is no angle");
    given.take("step", sensor.step);
    if (!(sensor.step >= 0.0)) throw py::value_error("sensor: step: must be >= 0");
    if (given.choice("rounding", {"none", "nearest"}) == 0) return;
    sensor.rounding = Sensor::Rounding::nearest;
    if (!(sensor.step > 0.0)) throw py::value_error("sensor: rounding needs the encoder's step > 0");
}

void read_functions(NamedArguments& given, const models::System& system, Sensor& sensor) {
    const auto names = models::reading_names(system.coordinates(), system.parameters(), system.inputs());
    const auto coordinates = coordinate_names(system);
    for (const auto& [key, value] : mapping(given.find_value("readings"), given.place("readings"))) {
        const auto name = key.cast<std::string>();
        const auto place = static_cast<std::size_t>(index_of(name, coordinates, "coordinate"));
        if (!py::isinstance<py::str>(value))
            throw py::type_error(given.place("readings") + ": " + name + ": needs a formula as text");
        sensor.functions.push_back({place, models::Expression::parse(value.cast<std::string>(), names)});
    }
    if (sensor.functions.empty()) throw py::value_error(given.place("readings") + ": there is none");
    std::sort(sensor.functions.begin(), sensor.functions.end(),
              [](const auto& a, const auto& b) { return a.coordinate < b.coordinate; });
}

}  // namespace

Sensor sensor(py::handle description, const models::System& system) {
    Sensor result;
    if (!description || description.is_none()) return result;
    NamedArguments given("sensor", description);
    if (!given.has("type")) throw py::type_error("sensor: 'type' is missing");
    const std::size_t type = given.choice("type", {"state", "function", "angle_difference"});
    if (type == 2) {
        result.type = Sensor::Type::angle_difference;
        read_encoder(given, system, result);
        result.rate = required_coordinate(given, "rate", system);
        if (result.rate == result.angle)
            throw py::value_error("sensor: rate: must be another coordinate than the angle");
        result.delay = given.required_number("delay");
        if (!(result.delay > 0.0)) throw py::value_error("sensor: delay: must be > 0");
    } else {
        if (type == 1) {
            result.type = Sensor::Type::function;
            read_functions(given, system, result);
        }
        // An encoder beside a state or formulas: all its keys or none.
        if (given.has("angle") || given.has("step") || given.has("rounding")) read_encoder(given, system, result);
    }
    given.finish();
    return result;
}

}  // namespace orbid::python
