#pragma once

#include <optional>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "estimator/interface/residual.hpp"
#include "models/arithmetic/matrix_layout.hpp"
#include "models/definition/sensor.hpp"
#include "models/system/system.hpp"
#include "periodic/orbit/shooting_mesh.hpp"

#pragma GCC visibility push(default)

namespace orbid::periodic {

/// One reading of all records of a waveform residual: one row of their values, one group of errors.
struct WaveformChannel {
    Eigen::Index coordinate = 0;                                     ///< of the model, in whose place the sensors read
    estimator::ErrorScale scale{true, 0.0, estimator::FlatPrior{}};  ///< start 0: from the residuals
    estimator::ErrorDistribution distribution = estimator::NormalErrors{};
    double floor = 0.0;      ///< least value of an estimated scale, >= 0
    bool known_sds = false;  ///< the scale is a factor on WaveformRecord::deviations
};

/// A phase or an offset of a record: estimated, or known.
struct WaveformUnknown {
    bool estimate = false;
    double value = 0.0;  ///< when known; unused otherwise: starts come from the data
};

/// A measured periodic steady state under one excitation.
struct WaveformRecord {
    std::string label;  ///< names it in messages and reports: "run1"
    /// The excitation: values of the parameters that hold here, and which of them are estimated.
    models::ParameterBinding binding;
    models::Sensor sensor;
    Eigen::VectorXd times;       ///< shape (m) [s], ascending; any rate, over one period or many
    Eigen::MatrixXd values;      ///< shape (channels, m); nan = missing
    Eigen::MatrixXd deviations;  ///< known sds, shape of values; empty: none is known
    int period = 1;              ///< forced models: of the orbit, in periods of the forcing, in [1, 64]
    double time = 0.0;           ///< autonomous flows: a guess of T [s], > 0, needed
    /// Of the forcing at time 0 [rad], within +- 2 pi p; autonomous flows: the time since the orbit's first point
    /// times 2 pi / T, always estimated.
    WaveformUnknown phase{true, 0.0};
    std::vector<WaveformUnknown> offsets;  ///< y = h(x) + offset, one per channel in its unit; empty: all known to be 0
    std::optional<StartingSolution> start;  ///< points at phase 0, or a state and T; empty: found, see waveform_start
};

}  // namespace orbid::periodic

#pragma GCC visibility pop
