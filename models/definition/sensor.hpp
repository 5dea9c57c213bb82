#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "models/definition/parameter.hpp"
#include "models/formulas/expression.hpp"

#pragma GCC visibility push(default)

namespace orbid::models {

/// A reading that is a formula of the state; it replaces one coordinate.
struct FunctionReading {
    std::size_t coordinate = 0;  ///< index of the coordinate that it replaces
    Expression expression;       ///< in the names that reading_names() lists
};

/// What the instrument reads at an instant.
///
/// state             the coordinates as the model says its instrument reads them (the plain state unless it says
///                   otherwise)
/// angle_difference  an angle, and as its rate the difference quotient [phi(t + delay) - phi(t)] / delay
///                   (mathematics.md, "Instrument"); other coordinates as in `state`
/// function          formulas of the coordinates of the STATE (not of what the model's instrument makes of them), of
/// the
///                   parameters and of the measured inputs at that instant; coordinates without a formula as in `state`
///
/// A formula is a real number: two readings differ by their plain difference, even in the place of an angle, whose
/// readings are otherwise compared modulo 2 pi. Angles in a formula are those of the flow, not wrapped. After a turn
/// phi + 0.01 phi^2 reads what it reads at phi + 2 pi.
struct Sensor {
    enum class Type { state, angle_difference, function };
    enum class Rounding { none, nearest };

    Type type = Type::state;
    std::size_t angle = 0;  ///< index of the coordinate that is read through an encoder (an angle)
    std::size_t rate = 1;   ///< index of the coordinate that the difference quotient stands for
    double delay = 0.0;     ///< [s], > 0 for angle_difference
    double step = 0.0;      ///< encoder step [rad], >= 0; 0 = continuous. Part of the error, never of the prediction
    Rounding rounding = Rounding::none;           ///< how a simulated reading of the angle is rounded to the step
    std::vector<FunctionReading> functions = {};  ///< of type function: at least one, of different coordinates
};

/// The formula that a sensor reads in the place of a coordinate; nullptr when there is none.
[[nodiscard]] const Expression* reading_function(const Sensor& sensor, std::size_t coordinate);

/// Readings in the place of this coordinate are angles: equal when they differ by whole turns.
[[nodiscard]] bool reads_angle(const Sensor& sensor, std::span<const Coordinate> coordinates, std::size_t coordinate);

/// The names that a formula may use: the coordinates, then the parameters, each in the order of the model's table.
[[nodiscard]] std::vector<std::string> reading_names(std::span<const Coordinate> coordinates,
                                                     std::span<const Parameter> parameters);
/// The same, and then the measured inputs of a model that has some.
[[nodiscard]] std::vector<std::string> reading_names(std::span<const Coordinate> coordinates,
                                                     std::span<const Parameter> parameters,
                                                     std::span<const Coordinate> inputs);

}  // namespace orbid::models

#pragma GCC visibility pop
