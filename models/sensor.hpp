#pragma once

#include <cstddef>

namespace orbid::models {

/// What the instrument reads at an instant.
///
/// state             the coordinates as the model says its instrument reads them (the plain state unless it says
/// otherwise) angle_difference  an angle, and as its rate the difference quotient [phi(t + delay) - phi(t)] / delay
/// (mathematics.md, "Instrument");
///                   other coordinates as in `state`
struct Sensor {
    enum class Type { state, angle_difference };
    enum class Rounding { none, nearest };

    Type type = Type::state;
    std::size_t angle = 0;  ///< index of the angle coordinate (angle_difference)
    std::size_t rate = 1;   ///< index of the coordinate that the difference quotient stands for
    double delay = 0.0;     ///< [s], > 0 for angle_difference
    double step = 0.0;      ///< encoder step [rad]; 0 = continuous. Part of the error, never of the prediction
    Rounding rounding = Rounding::none;  ///< how a simulated reading of the angle is rounded to the step
};

}  // namespace orbid::models
