#pragma once

#include <optional>
#include <span>
#include <string>

#include <Eigen/Core>

#include "models/arithmetic/matrix_layout.hpp"
#include "models/definition/sensor.hpp"
#include "models/formulas/expression.hpp"
#include "models/system/system.hpp"
#include "periodic/orbit/orbit.hpp"

#pragma GCC visibility push(default)

namespace orbid::periodic {

/// What is measured of a periodic motion. The frequency is 1 / T of the orbit [Hz], that of a forced orbit of period p
/// is the p-th part of its forcing's.
enum class OrbitMeasure { maximum, minimum, mean, half_range, rms, frequency };

/// A quantity of a motion that is no coordinate: a formula of state and parameters, as those of sensors.
struct OrbitReading {
    std::string name;
    std::string unit;
    models::Expression formula;  ///< in the names that models::reading_names() lists
};

/// A measure of an orbit with its derivatives.
struct MeasuredValue {
    double value = 0.0;
    Eigen::RowVectorXd by_parameters;  ///< shape (f)
};

/// The readings of a sensor along a whole orbit, from which measures follow. Readings stand at equal shares of the
/// orbit, 64 to 512 of them, as many as their Fourier series needs to end below 1e-10 of its size. Means over them, and
/// extrema of the series, converge faster than any power of their number for smooth orbits. Where friction or impacts
/// leave kinks they are those of 512 readings.
class OrbitReadings {
public:
    /// @param orbit     solved at phase 0 with these `theta`, with sensitivities to `free` where derivatives are
    /// needed.
    /// @param formulas  read beside the sensor: reading n + i of a model with n coordinates is formula i, a real
    /// number.
    OrbitReadings(const models::System& system, const Eigen::VectorXd& theta, const PeriodicOrbit& orbit,
                  const models::Sensor& sensor, std::optional<std::span<const Eigen::Index>> free,
                  const models::FlowOptions& options, std::span<const OrbitReading> formulas = {});

    [[nodiscard]] bool simulated() const { return simulated_; }
    /// @param reading  the coordinate in whose place the sensor reads, or n + i for formula i; without meaning for the
    ///                 frequency.
    /// @return nothing for an angle that turns around, and for a formula that is another one after a turn.
    [[nodiscard]] std::optional<MeasuredValue> measure(OrbitMeasure measure, Eigen::Index reading) const;

private:
    bool read(const models::System& system, const Eigen::VectorXd& theta, const PeriodicOrbit& orbit,
              const std::vector<models::Sensor>& sensors, std::optional<std::span<const Eigen::Index>> free,
              Eigen::Index count, const models::FlowOptions& options);
    [[nodiscard]] bool resolved() const;
    [[nodiscard]] MeasuredValue extremum(Eigen::Index coordinate, double sign) const;
    /// Weighted sum of the readings.
    [[nodiscard]] MeasuredValue weighted(Eigen::Index coordinate, const Eigen::VectorXd& weights) const;

    bool simulated_ = false;
    Eigen::MatrixXd readings_;       ///< shape (r, m), angles continuous with a mean in one turn
    Eigen::MatrixXd by_parameters_;  ///< shape (r, m f), share of the orbit fixed
    std::vector<bool> turning_;      ///< readings that are others after a turn
    MeasuredValue frequency_;
};

}  // namespace orbid::periodic

#pragma GCC visibility pop
