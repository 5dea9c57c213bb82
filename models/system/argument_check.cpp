#include "models/system/argument_check.hpp"

#include <fmt/format.h>

#include <cmath>
#include <stdexcept>

namespace orbid::models {

namespace {

[[noreturn]] void refuse(const System& system, const std::string& message) {
    throw std::invalid_argument(fmt::format("model {}: {}", system.name(), message));
}

void check_functions(const System& system, const Sensor& sensor) {
    const std::size_t n = system.coordinates().size();
    const std::size_t names = n + system.parameters().size() + system.inputs().size();
    if (sensor.functions.empty()) refuse(system, "sensor function: has no formula, must have at least one");
    for (std::size_t i = 0; i < sensor.functions.size(); ++i) {
        const FunctionReading& reading = sensor.functions[i];
        if (!(reading.coordinate < n))
            refuse(system, fmt::format("sensor function: formula {} stands in the place of coordinate {}, there are {}",
                                       i, reading.coordinate, n));
        for (std::size_t j = 0; j < i; ++j)
            if (sensor.functions[j].coordinate == reading.coordinate)
                refuse(system, fmt::format("sensor function: coordinate {} has two formulas",
                                           system.coordinates()[reading.coordinate].name));
        if (reading.expression.steps().empty()) refuse(system, fmt::format("sensor function: formula {} is empty", i));
        // Parsed with other names than reading_names() of this system.
        if (!reading.expression.used().empty() && reading.expression.used().back() >= names)
            refuse(system, fmt::format("sensor function: formula {} uses name {}, there are {} coordinates, "
                                       "parameters and inputs",
                                       i, reading.expression.used().back(), names));
    }
}

}  // namespace

void check_parameters(const System& system, const Eigen::VectorXd& theta) {
    const auto table = system.parameters();
    if (theta.size() != static_cast<Eigen::Index>(table.size()))
        refuse(system, fmt::format("number of parameters is {}, must be {}", theta.size(), table.size()));
    for (std::size_t i = 0; i < table.size(); ++i) {
        const double value = theta[static_cast<Eigen::Index>(i)];
        if (!contains(table[i].domain, value))
            refuse(system, fmt::format("parameter {} is {}, must be {}", table[i].name, value, rule(table[i].domain)));
    }
}

void check_state(const System& system, const Eigen::VectorXd& state) {
    const auto table = system.coordinates();
    if (state.size() != static_cast<Eigen::Index>(table.size()))
        refuse(system, fmt::format("length of a state is {}, must be {}", state.size(), table.size()));
    for (std::size_t i = 0; i < table.size(); ++i)
        if (const double value = state[static_cast<Eigen::Index>(i)]; !std::isfinite(value))
            refuse(system, fmt::format("coordinate {} is {}, must be a finite number", table[i].name, value));
}

void check_columns(const System& system, const Eigen::MatrixXd& states, std::span<const double> phases) {
    if (states.rows() != system.dimension())
        refuse(system, fmt::format("number of rows of states is {}, must be {}", states.rows(), system.dimension()));
    if (static_cast<std::size_t>(states.cols()) != phases.size())
        refuse(system, fmt::format("number of phases is {}, must be {}: one per column of states", phases.size(),
                                   states.cols()));
    const auto table = system.coordinates();
    for (Eigen::Index k = 0; k < states.cols(); ++k) {
        if (!std::isfinite(phases[static_cast<std::size_t>(k)]))
            refuse(system,
                   fmt::format("phase {} is {}, must be a finite number", k, phases[static_cast<std::size_t>(k)]));
        for (Eigen::Index i = 0; i < states.rows(); ++i)
            if (!std::isfinite(states(i, k)))
                refuse(system, fmt::format("coordinate {} of column {} is {}, must be a finite number",
                                           table[static_cast<std::size_t>(i)].name, k, states(i, k)));
    }
}

void check_free(const System& system, std::span<const Eigen::Index> free) {
    const auto count = static_cast<Eigen::Index>(system.parameters().size());
    for (std::size_t i = 0; i < free.size(); ++i) {
        if (!(free[i] >= 0 && free[i] < count))
            refuse(system, fmt::format("index of a free parameter is {}, must be in [0, {})", free[i], count));
        for (std::size_t j = 0; j < i; ++j)
            if (free[j] == free[i])
                refuse(system, fmt::format("free parameter {} is listed twice",
                                           system.parameters()[static_cast<std::size_t>(free[i])].name));
    }
}

void check_options(const FlowOptions& options) {
    const auto positive_number = [](const char* name, double value) {
        if (!(std::isfinite(value) && value > 0.0))
            throw std::invalid_argument(fmt::format("flow option {} is {}, must be > 0", name, value));
    };
    positive_number("relative_tolerance", options.relative_tolerance);
    positive_number("absolute_tolerance", options.absolute_tolerance);
    if (options.maximum_steps == 0) throw std::invalid_argument("flow option maximum_steps is 0, must be > 0");
}

void check_sensor(const System& system, const Sensor& sensor) {
    const auto table = system.coordinates();
    const bool encodes = sensor.step != 0.0 || sensor.rounding != Sensor::Rounding::none;
    if (!(std::isfinite(sensor.step) && sensor.step >= 0.0))
        refuse(system, fmt::format("sensor: step of the encoder is {}, must be >= 0", sensor.step));
    if (sensor.type == Sensor::Type::angle_difference || encodes)
        if (!(sensor.angle < table.size() && table[sensor.angle].angle))
            refuse(system, fmt::format("sensor: coordinate {} is not an angle", sensor.angle));
    if (sensor.type == Sensor::Type::function) return check_functions(system, sensor);
    if (sensor.type == Sensor::Type::state) return;
    if (system.kind() == Kind::map) refuse(system, "sensor angle_difference: a map has no time between two readings");
    if (!(sensor.rate < table.size() && sensor.rate != sensor.angle))
        refuse(system, fmt::format("sensor angle_difference: rate is coordinate {}, must be another one than the angle",
                                   sensor.rate));
    if (!(std::isfinite(sensor.delay) && sensor.delay > 0.0))
        refuse(system, fmt::format("sensor angle_difference: delay is {}, must be > 0", sensor.delay));
}

void check_section(const System& system, const Section& section, double longest) {
    if (section.normal.size() != system.dimension())
        refuse(system, fmt::format("normal of the section has {} entries, must have {}", section.normal.size(),
                                   system.dimension()));
    if (!(section.normal.allFinite() && section.normal.squaredNorm() > 0.0))
        refuse(system, "normal of the section must be finite and not 0");
    if (!std::isfinite(section.offset))
        refuse(system, fmt::format("offset of the section is {}, must be a finite number", section.offset));
    if (section.direction != 1 && section.direction != -1)
        refuse(system, fmt::format("direction of the section is {}, must be 1 or -1", section.direction));
    if (!(longest > 0.0 && std::isfinite(longest)))
        refuse(system, fmt::format("longest return time is {}, must be > 0", longest));
}

void check_flow(const System& system, const Eigen::VectorXd& x0, double phase, std::span<const double> durations,
                const Eigen::VectorXd& theta, std::span<const Eigen::Index> free, Clock clock,
                const FlowOptions& options) {
    check_parameters(system, theta);
    check_state(system, x0);
    check_options(options);
    check_free(system, free);
    if (!std::isfinite(phase)) refuse(system, fmt::format("phase is {}, must be a finite number", phase));
    if (clock == Clock::phase && system.kind() != Kind::forced)
        refuse(system, "only forced models can be measured by the phase of their forcing");
    double before = 0.0;
    for (std::size_t k = 0; k < durations.size(); ++k) {
        if (!(std::isfinite(durations[k]) && durations[k] >= before))
            refuse(system,
                   fmt::format("duration {} is {}, must be >= {}: durations ascend from 0", k, durations[k], before));
        if (system.kind() == Kind::map && durations[k] != std::floor(durations[k]))
            refuse(system, fmt::format("duration {} is {}, must be a whole number of iterations", k, durations[k]));
        before = durations[k];
    }
}

}  // namespace orbid::models
