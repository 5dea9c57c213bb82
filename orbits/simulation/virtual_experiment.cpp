#include "orbits/simulation/virtual_experiment.hpp"

#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

#include <fmt/format.h>

#include "estimator/interface/random_stream.hpp"
#include "models/system/argument_check.hpp"
#include "models/system/stopped.hpp"
#include "orbits/simulation/node_state.hpp"
#include "orbits/simulation/section_record.hpp"

namespace orbid::orbits {
namespace {

template <class... Values>
void require(bool rule, fmt::format_string<Values...> message, Values&&... values) {
    if (!rule)
        throw std::invalid_argument("virtual experiment: " + fmt::format(message, std::forward<Values>(values)...));
}

void validate_plan(const models::System& system, const VirtualExperimentOptions& options) {
    if (const auto* plan = std::get_if<SectionPlan>(&options.plan)) {
        require(plan->sections > 0, "sections is 0, must be > 0");
        const bool autonomous = system.kind() == models::Kind::autonomous;
        require(!autonomous || plan->section,
                "model {} is not forced and has no sections at a phase; name a plane, or record samples",
                system.name());
        require(autonomous || !plan->section,
                "model {} is not autonomous: its sections are {}, not crossings of a plane", system.name(),
                system.kind() == models::Kind::map ? "its iterates" : "at a phase of the forcing");
        require(!plan->section || system.inputs().empty(),
                "model {} reads measured inputs, which tell the time: it has no sections by a plane; record samples",
                system.name());
        require(plan->longest_return >= 0.0 && std::isfinite(plan->longest_return),
                "longest return time is {} s, must be > 0, or 0 to have it found", plan->longest_return);
        // 1 s stands for a time that is found later.
        if (plan->section)
            models::check_section(system, *plan->section, plan->longest_return > 0.0 ? plan->longest_return : 1.0);
    } else {
        const auto& samples = std::get<SamplePlan>(options.plan);
        require(samples.count > 0, "count of samples is 0, must be > 0");
        require(samples.step > 0.0 && std::isfinite(samples.step), "sampling step is {} s, must be > 0", samples.step);
        require(system.kind() != models::Kind::map, "model {} is a map and has no samples in time; record sections",
                system.name());
    }
}

void validate(const models::System& system, const VirtualExperimentOptions& options) {
    const Eigen::Index n = system.dimension();
    validate_plan(system, options);
    require(options.trajectories > 0, "trajectories is 0, must be > 0");
    require(std::isfinite(options.phase), "phase must be a finite number");
    require(options.initial.cols() == 0 || (options.initial.rows() == n &&
                                            options.initial.cols() == static_cast<Eigen::Index>(options.trajectories)),
            "initial states have shape ({}, {}), must be ({}, {}): one per trajectory", options.initial.rows(),
            options.initial.cols(), n, options.trajectories);
    require(options.initial.allFinite(), "initial states must be finite numbers");
    require(options.noise.size() == 0 || options.noise.size() == n, "noise has {} entries, must have {} or none",
            options.noise.size(), n);
    require(options.noise_correlation.size() == 0 || options.noise_correlation.size() == n,
            "correlation of the noise has {} entries, must have {} or none", options.noise_correlation.size(), n);
    require(options.random_range.size() == 0 || options.random_range.size() == n,
            "random range has {} entries, must have {} or none", options.random_range.size(), n);
    for (Eigen::Index i = 0; i < n; ++i) {
        const models::Coordinate& coordinate = system.coordinates()[static_cast<std::size_t>(i)];
        if (options.noise.size() > 0)
            require(options.noise[i] >= 0.0 && std::isfinite(options.noise[i]), "noise of {} is {}, must be >= 0",
                    coordinate.name, options.noise[i]);
        if (options.noise_correlation.size() > 0)
            require(std::abs(options.noise_correlation[i]) < 1.0,
                    "correlation of the noise of {} is {}, must lie between -1 and 1", coordinate.name,
                    options.noise_correlation[i]);
        if (options.random_range.size() > 0 && !coordinate.angle)
            require(options.random_range[i] > 0.0 && std::isfinite(options.random_range[i]),
                    "random range of {} is {}, must be > 0", coordinate.name, options.random_range[i]);
    }
    if (options.sensor.type == models::Sensor::Type::angle_difference) {
        require(
            static_cast<Eigen::Index>(options.sensor.rate) < n && static_cast<Eigen::Index>(options.sensor.angle) < n,
            "sensor: angle and rate must be coordinates of the model");
        const auto rate = static_cast<Eigen::Index>(options.sensor.rate);
        require(options.noise.size() == 0 || options.noise[rate] == 0.0,
                "noise of {} must be 0: its error follows from the angle readings it is the difference of",
                system.coordinates()[options.sensor.rate].name);
        require(options.noise_correlation.size() == 0 || options.noise_correlation.isZero(0.0),
                "noise of a difference sensor, which reads an angle twice, cannot be correlated");
    }
}

/// Replaces states by what the sensor reads of them, and asks in between. The blocks are multiples of the lanes in
/// which states may flow together.
/// @param rate  of the phase [rad/s]
/// @return ok, or why a state cannot be read.
models::FlowStatus read_in_blocks(const models::System& system, const Eigen::VectorXd& theta,
                                  const VirtualExperimentOptions& options, double rate, StateRecord::Piece& piece) {
    constexpr Eigen::Index block = 1 << 16;
    for (Eigen::Index start = 0; start < piece.states.cols(); start += block) {
        models::stop_if_asked(options.interrupted);
        const Eigen::Index count = std::min(block, piece.states.cols() - start);
        std::vector<double> phases(static_cast<std::size_t>(count), options.phase);
        if (piece.times.size() > 0)
            for (Eigen::Index k = 0; k < count; ++k)
                phases[static_cast<std::size_t>(k)] += rate * piece.times[start + k];
        auto part = piece.states.middleCols(start, count);
        const auto read = system.readings(options.sensor, part, phases, theta, std::nullopt, options.flow);
        if (read.status != models::FlowStatus::ok) return read.status;
        part = read.readings;
    }
    return models::FlowStatus::ok;
}

double rounded(double value, const models::Sensor& sensor) {
    const bool rounds = sensor.rounding == models::Sensor::Rounding::nearest && sensor.step > 0.0;
    return rounds ? sensor.step * std::round(value / sensor.step) : value;
}

/// Adds the errors of one segment's readings and rounds them (mathematics.md, "Instrument").
void add_reading_errors(Readings& readings, const models::Sensor& sensor, const Eigen::VectorXd& noise,
                        const Eigen::VectorXd& correlation, estimator::RandomStream stream,
                        const std::function<bool()>& interrupted) {
    const bool difference = sensor.type == models::Sensor::Type::angle_difference;
    const auto angle = static_cast<Eigen::Index>(sensor.angle);
    const auto rate = static_cast<Eigen::Index>(sensor.rate);
    const auto error = [&](Eigen::Index i) {
        return noise.size() > 0 && noise[i] > 0.0 ? noise[i] * stream.normal() : 0.0;
    };
    // The first error is drawn from the stationary distribution; 0 leaves independent errors as they are, to the bit.
    Eigen::VectorXd last = Eigen::VectorXd::Zero(readings.rows());
    const auto correlated = [&](Eigen::Index i, Eigen::Index k) {
        const double fresh = error(i);
        const double rho = correlation.size() > 0 ? correlation[i] : 0.0;
        last[i] = k == 0 || rho == 0.0 ? fresh : rho * last[i] + std::sqrt((1.0 - rho) * (1.0 + rho)) * fresh;
        return last[i];
    };
    for (Eigen::Index k = 0; k < readings.cols(); ++k) {
        if (k % 65536 == 0) models::stop_if_asked(interrupted);
        const double later = difference ? readings(angle, k) + sensor.delay * readings(rate, k) : 0.0;
        for (Eigen::Index i = 0; i < readings.rows(); ++i)
            if (!(difference && i == rate)) readings(i, k) += correlated(i, k);
        if (angle < readings.rows()) readings(angle, k) = rounded(readings(angle, k), sensor);
        if (difference) readings(rate, k) = (rounded(later + error(angle), sensor) - readings(angle, k)) / sensor.delay;
    }
}

/// What record_sections() needs to know of crossings and was not told. Starts that are given are the best probes.
ReturnProbe probe_of(const models::System& system, const Eigen::VectorXd& theta,
                     const VirtualExperimentOptions& options, const models::Section& section) {
    const Eigen::VectorXd half =
        options.random_range.size() > 0 ? options.random_range : Eigen::VectorXd::Ones(system.dimension());
    const Eigen::MatrixXd starts =
        options.initial.cols() > 0
            ? Eigen::MatrixXd(options.initial.leftCols(std::min(probe_count, options.initial.cols())))
            : probe_starts(system, half, options.seed);
    ReturnProbe probe = probe_returns(system, theta, section, starts, options.flow);
    if (options.random_range.size() > 0) probe.range = options.random_range;
    return probe;
}

StateRecord record_plan(const models::System& system, const Eigen::VectorXd& theta,
                        const VirtualExperimentOptions& options) {
    if (const auto* plan = std::get_if<SectionPlan>(&options.plan)) {
        if (plan->section) {
            ReturnProbe probe{options.random_range, plan->longest_return};
            if (probe.range.size() == 0 || !(probe.longest_return > 0.0))
                probe = probe_of(system, theta, options, *plan->section);
            return record_sections(system, theta, options, probe.range,
                                   plan->longest_return > 0.0 ? plan->longest_return : probe.longest_return);
        }
    }
    double duration = 0.0;
    const auto* samples = std::get_if<SamplePlan>(&options.plan);
    if (samples != nullptr) {
        // Measured inputs end with the last sample.
        const std::size_t after = system.inputs().empty() ? 0 : 1;
        duration = samples->step * static_cast<double>(samples->transient + samples->count - after);
    }
    Eigen::VectorXd range = options.random_range;
    // Samples need no range where all first states are given.
    if (range.size() == 0 && (samples == nullptr || options.initial.cols() == 0))
        range = typical_range(system, theta, options.phase, duration, options.seed, options.flow);
    return samples != nullptr ? record_samples(system, theta, options, range)
                              : record_sections(system, theta, options, range, 0.0);
}

}  // namespace

std::string_view name(TrajectoryEvent::Kind kind) {
    switch (kind) {
        case TrajectoryEvent::Kind::captured:
            return "captured";
        case TrajectoryEvent::Kind::at_rest:
            return "at_rest";
        case TrajectoryEvent::Kind::failed:
            return "failed";
        case TrajectoryEvent::Kind::restarted:
            return "restarted";
    }
    return "";
}

VirtualExperiment simulate(const models::System& system, const Eigen::VectorXd& theta,
                           const VirtualExperimentOptions& options) {
    validate(system, options);
    const auto* samples = std::get_if<SamplePlan>(&options.plan);
    StateRecord record = record_plan(system, theta, options);

    VirtualExperiment experiment;
    experiment.events = std::move(record.events);
    experiment.complete = record.complete;
    experiment.message = std::move(record.message);
    Series& series = experiment.series;
    series.sampling = samples != nullptr ? Series::Sampling::samples : Series::Sampling::section;
    series.phase = options.phase;
    for (std::size_t i = 0; i < system.coordinates().size(); ++i) {
        const models::Coordinate& coordinate = system.coordinates()[i];
        series.coordinates.push_back({std::string(coordinate.name), std::string(coordinate.unit),
                                      models::reads_angle(options.sensor, system.coordinates(), i)});
    }
    const double rate = samples != nullptr ? phase_rate(system, theta) : 0.0;
    for (std::size_t s = 0; s < record.pieces.size(); ++s) {
        StateRecord::Piece& piece = record.pieces[s];
        const models::FlowStatus status = read_in_blocks(system, theta, options, rate, piece);
        if (status != models::FlowStatus::ok) {
            experiment.complete = false;
            experiment.message += fmt::format("{}segment {} cannot be read: {}", experiment.message.empty() ? "" : "; ",
                                              s, models::description(status));
            continue;
        }
        series.segments.push_back({std::to_string(s), std::move(piece.states), std::move(piece.times), {}});
    }
    oneapi::tbb::parallel_for(std::size_t{0}, series.segments.size(), [&](std::size_t s) {
        add_reading_errors(series.segments[s].values, options.sensor, options.noise, options.noise_correlation,
                           estimator::RandomStream(options.seed, estimator::RandomPurpose::reading_noise, s),
                           options.interrupted);
    });
    return experiment;
}

}  // namespace orbid::orbits
