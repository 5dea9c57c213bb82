#pragma once

#include <algorithm>
#include <cstdint>
#include <numbers>
#include <numeric>
#include <span>
#include <vector>

#include "estimator/interface/random_stream.hpp"
#include "models/catalogue/registry.hpp"
#include "models/system/system.hpp"
#include "periodic/waveforms/waveform_record.hpp"
#include "tests/catch.hpp"

namespace orbid::tests {

/// Estimated parameters by name, in this order; all others at the values given.
inline models::ParameterBinding estimated(const models::System& system, const Eigen::VectorXd& values,
                                          const std::vector<std::string_view>& names) {
    models::ParameterBinding binding;
    binding.base = values;
    for (std::size_t i = 0; i < names.size(); ++i) {
        binding.parameter.push_back(system.parameter_index(names[i]));
        binding.estimated.push_back(static_cast<Eigen::Index>(i));
    }
    binding.estimated_count = static_cast<Eigen::Index>(names.size());
    return binding;
}

/// Values of a model with some of them set.
inline Eigen::VectorXd with_values(const models::System& system,
                                   const std::vector<std::pair<std::string_view, double>>& values) {
    Eigen::VectorXd theta = system.default_parameters();
    for (const auto& value : values)
        theta(system.parameter_index(value.first)) = value.second;
    return theta;
}

inline Eigen::VectorXd picked(const models::ParameterBinding& binding) {
    Eigen::VectorXd theta(binding.estimated_count);
    for (std::size_t i = 0; i < binding.parameter.size(); ++i)
        theta(binding.estimated[i]) = binding.base(binding.parameter[i]);
    return theta;
}

/// What a sensor reads in the steady state that motion from x0 reaches after `transient` seconds, all coordinates, the
/// phase of the forcing being `phase` at time 0 of the record.
inline Eigen::MatrixXd steady_readings(const models::System& system, const Eigen::VectorXd& theta,
                                       const Eigen::VectorXd& x0, const models::Sensor& sensor,
                                       const Eigen::VectorXd& times, double phase, double transient) {
    const bool forced = system.kind() == models::Kind::forced;
    const double rate = forced ? 2.0 * std::numbers::pi / system.period(theta, models::Clock::time) : 0.0;
    std::vector<double> durations, phases;
    for (Eigen::Index k = 0; k < times.size(); ++k) {
        durations.push_back(transient + times(k) - times(0));
        phases.push_back(phase + rate * times(k));
    }
    const auto flow = system.flow(x0, phase + rate * (times(0) - transient), durations, theta, models::Clock::time);
    REQUIRE(flow.status == models::FlowStatus::ok);
    const auto read = system.readings(sensor, flow.states, phases, theta);
    REQUIRE(read.status == models::FlowStatus::ok);
    return read.readings;
}

/// Channels of these coordinates, normal errors of unknown sd.
inline std::vector<periodic::WaveformChannel> channels_of(const models::System& system,
                                                          const std::vector<std::string_view>& names) {
    std::vector<periodic::WaveformChannel> channels;
    for (const std::string_view name : names) {
        channels.emplace_back();
        channels.back().coordinate = system.coordinate_index(name);
    }
    return channels;
}

/// A record of some rows of readings; the times are the record's.
inline periodic::WaveformRecord record_of(const models::ParameterBinding& binding, const Eigen::VectorXd& times,
                                          const Eigen::MatrixXd& readings,
                                          const std::vector<periodic::WaveformChannel>& channels) {
    periodic::WaveformRecord record;
    record.label = "run1";
    record.binding = binding;
    record.times = times;
    record.values.resize(std::ssize(channels), times.size());
    for (std::size_t c = 0; c < channels.size(); ++c)
        record.values.row(static_cast<Eigen::Index>(c)) = readings.row(channels[c].coordinate);
    return record;
}

}  // namespace orbid::tests
