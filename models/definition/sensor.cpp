#include "models/definition/sensor.hpp"

namespace orbid::models {

const Expression* reading_function(const Sensor& sensor, std::size_t coordinate) {
    if (sensor.type != Sensor::Type::function) return nullptr;
    for (const FunctionReading& reading : sensor.functions)
        if (reading.coordinate == coordinate) return &reading.expression;
    return nullptr;
}

bool reads_angle(const Sensor& sensor, std::span<const Coordinate> coordinates, std::size_t coordinate) {
    return coordinates[coordinate].angle && reading_function(sensor, coordinate) == nullptr;
}

std::vector<std::string> reading_names(std::span<const Coordinate> coordinates, std::span<const Parameter> parameters) {
    std::vector<std::string> names;
    names.reserve(coordinates.size() + parameters.size());
    for (const Coordinate& coordinate : coordinates)
        names.emplace_back(coordinate.name);
    for (const Parameter& parameter : parameters)
        names.emplace_back(parameter.name);
    return names;
}

std::vector<std::string> reading_names(std::span<const Coordinate> coordinates, std::span<const Parameter> parameters,
                                       std::span<const Coordinate> inputs) {
    std::vector<std::string> names = reading_names(coordinates, parameters);
    for (const Coordinate& input : inputs)
        names.emplace_back(input.name);
    return names;
}

}  // namespace orbid::models
