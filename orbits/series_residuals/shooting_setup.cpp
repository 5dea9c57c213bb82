#include <algorithm>
#include <cmath>
#include <variant>

#include <fmt/format.h>

#include "orbits/records/refusal.hpp"
#include "orbits/series_residuals/observed_channels.hpp"
#include "orbits/series_residuals/process_noise.hpp"
#include "orbits/series_residuals/shooting_residual.hpp"
#include "orbits/simulation/node_state.hpp"
#include "orbits/simulation/state_track.hpp"
#include "orbits/simulation/transition.hpp"

namespace orbid::orbits {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr std::string_view shooting_messages = "shooting residual";

void choose_segments(const ObservedChannels& channels, const Series& series, std::vector<std::size_t>& chosen) {
    channels.choose_segments(chosen);
    for (const std::size_t s : chosen) {
        const Segment& segment = series.segments[s];
        channels.require_call(segment.values.rows() == series.dimension() && segment.values.cols() > 0 &&
                                  (segment.times.size() == 0 || segment.times.size() == segment.values.cols()),
                              "segment {}: values and times do not fit the series", segment.label);
        channels.require(segment.values.array().isFinite().any(), "segment {} has no reading", segment.label);
    }
}

std::vector<ObservedCoordinate> choose_coordinates(const ObservedChannels& channels, ShootingOptions& options) {
    std::vector<ObservedCoordinate> observed = channels.chosen(options.observe);
    const models::Sensor& sensor = options.sensor;
    const bool difference = sensor.type == models::Sensor::Type::angle_difference;
    int groups = 0;
    int angle_group = -1;
    for (ObservedCoordinate& o : observed) {
        if (difference && o.coordinate == static_cast<Index>(sensor.rate)) continue;
        if (o.coordinate == static_cast<Index>(sensor.angle)) angle_group = groups;
        o.group = groups++;
    }
    channels.require(!difference || angle_group >= 0, "the angle of an angle_difference sensor must be observed");
    for (ObservedCoordinate& o : observed)
        if (difference && o.coordinate == static_cast<Index>(sensor.rate)) o.group = angle_group;
    channels.check_count(options.errors.size(), "scales", observed.size());
    channels.check_count(options.forms.size(), "distributions", observed.size());
    return observed;
}

void check_forms(const ObservedChannels& channels, const models::System& system, const ShootingOptions& options,
                 std::vector<ObservedCoordinate>& observed) {
    const bool difference = options.sensor.type == models::Sensor::Type::angle_difference;
    for (std::size_t i = 0; i < options.forms.size(); ++i) {
        const ErrorForm& form = options.forms[i];
        const auto name = system.coordinates()[static_cast<std::size_t>(observed[i].coordinate)].name;
        channels.check_form(form, options.sensor, observed[i].coordinate);
        channels.require(!is_sized(form.distribution) || !form.known_sds,
                         "errors of {}: known sds go with normal, Student's t or Laplace errors", name);
        channels.require(
            !std::holds_alternative<estimator::AutoregressiveErrors>(form.distribution),
            "errors of {}: autoregressive errors would begin anew at every node; use one initial state per segment",
            name);
        channels.require(!form.known_sds || !difference,
                         "errors of {}: readings of a difference sensor have one error, that of its angle", name);
        observed[i].known_sds = form.known_sds;
    }
}

/// Readings must suit the errors that they have.
void check_readings(const ObservedChannels& channels, const Series& series, const ShootingOptions& options,
                    const std::vector<ObservedCoordinate>& observed) {
    for (std::size_t i = 0; i < options.forms.size(); ++i) {
        const ObservedCoordinate& o = observed[i];
        if (!o.known_sds && !is_sized(options.forms[i].distribution)) continue;
        for (const std::size_t s : options.segments) {
            const Segment& data = series.segments[s];
            for (Index k = 0; k < data.values.cols(); ++k) {
                if (!std::isfinite(data.values(o.row, k))) continue;
                channels.check_reading(options.forms[i], data, o.row, k);
                if (o.known_sds) channels.known_sd(data, o.row, k);
            }
        }
    }
}

}  // namespace

void ShootingResidual::check_matching() const {
    const ObservedChannels channels(shooting_messages, data_->system(), data_->series);
    const Index n = data_->system().dimension();
    channels.require_call(matching_.sd.size() == 0 || matching_.sd.size() == n, "{} matching sds for {} coordinates",
                          matching_.sd.size(), n);
    for (const double sd : matching_.sd)
        channels.require_call(sd > 0.0 && std::isfinite(sd), "a matching sd is {}, must be > 0", sd);
    channels.require_call(
        matching_.kind != Continuity::Kind::diffusion || (matching_.estimate && matching_.sd.size() == 0),
        "the diffusion of process noise is estimated, and begins at what nodes leave");
    channels.require(matching_.kind != Continuity::Kind::diffusion || sampled(),
                     "process noise needs samples in time: over a whole period it depends on all of the course");
    channels.require_call(matching_.kind == Continuity::Kind::exact || matching_.estimate || matching_.sd.size() > 0,
                          "matching with an error of its own needs its sds, or to estimate them");
    channels.require_call(!matching_.estimate || matching_.kind != Continuity::Kind::exact,
                          "exact matching has no sd that could be estimated: choose normal or Student's t");
    channels.require_call(!matching_.constraints || matching_.kind == Continuity::Kind::exact,
                          "only exact matching can be done by constraints");
}

std::shared_ptr<ShootingResidual::Data> ShootingResidual::read(std::shared_ptr<const models::System> system,
                                                               models::ParameterBinding binding, Series series,
                                                               ShootingOptions options) {
    refuse_if(system == nullptr, "{}: a system is needed", shooting_messages);
    const ObservedChannels channels(shooting_messages, *system, series);
    channels.check_binding(binding, options.start);
    channels.check_clock();
    channels.require(
        series.sampling != Series::Sampling::section || system->kind() != models::Kind::autonomous || series.timed(),
        "crossings of the autonomous model {} need their times", system->name());
    channels.require_call(options.interval >= 0, "interval is {}, must be > 0, or 0 to be chosen", options.interval);
    choose_segments(channels, series, options.segments);
    auto data = std::make_shared<Data>();
    data->observed = choose_coordinates(channels, options);
    check_forms(channels, *system, options, data->observed);
    check_readings(channels, series, options, data->observed);
    data->instant_sensor = options.sensor;
    if (options.sensor.type == models::Sensor::Type::angle_difference)
        data->instant_sensor.type = models::Sensor::Type::state;
    if (options.delay) {
        channels.check_delay(*options.delay, binding, options.inputs, options.sensor);
        // Starts of nodes are those of the delay at the start. What a phase adds to the clock goes into the times.
        for (Segment& segment : series.segments)
            segment.times.array() += series.phase;
        const VectorXd start = options.start.size() > 0 ? binding.values(options.start) : binding.base;
        series.phase = -start[options.delay->parameter];
    }
    data->systems = channels.with_inputs(options.inputs, options.sensor, options.delay);
    data->delay_slopes = delay_slopes(options.delay, binding);
    if (options.inputs.empty()) data->systems.push_back(system);
    data->omega_slopes = frequency_slopes(*system, binding);
    data->binding = std::move(binding);
    data->series = std::move(series);
    data->options = std::move(options);
    return data;
}

/// States of all segments, where readings do not tell them one by one.
void ShootingResidual::follow_states(Data& data, const VectorXd& all) {
    FollowedSeries found;
    found.states.resize(data.series.segments.size());
    found.reading_sd = VectorXd::Zero(data.series.dimension());
    std::vector<Index> free = data.binding.parameter;
    if (data.options.delay) std::erase(free, data.options.delay->parameter);
    for (const std::size_t s : data.options.segments) {
        const models::System& system = *data.systems[data.systems.size() == 1 ? 0 : s];
        StateTrack track = track_states(system, all, data.series, s, data.options.sensor, data.options.first_state,
                                        free, data.options.following_work);
        if (found.theta.size() == 0) found.theta = track.theta;
        found.states[s] = std::move(track.states);
        found.reading_sd = found.reading_sd.cwiseMax(track.reading_sd);
    }
    data.followed = std::make_shared<const FollowedSeries>(std::move(found));
}

/// Sizes of the coordinates and of what is read in their place.
void ShootingResidual::take_ranges(Data& data) {
    const models::System& system = data.system();
    MatrixXd states(system.dimension(), std::ssize(initial_.latents));
    for (std::size_t b = 0; b < initial_.latents.size(); ++b)
        states.col(static_cast<Index>(b)) = initial_.latents[b];
    const models::Sensor& sensor = data.options.sensor;
    const bool formulas = sensor.type == models::Sensor::Type::function;
    data.range = formulas ? state_range(system, states) : coordinate_range(system, data.series, states);
    const VectorXd read = data.series.scale();
    for (const ObservedCoordinate& o : data.observed) {
        if (o.group != std::ssize(data.reading_range)) continue;
        const bool formula = models::reading_function(sensor, static_cast<std::size_t>(o.coordinate)) != nullptr;
        data.reading_range.push_back(formula ? read[o.row] : data.range[o.coordinate]);
    }
    if (matching_.share > 0.0) matching_.sd = matching_.share * data.range;
}

void ShootingResidual::make_groups() {
    const Data& data = *data_;
    const models::Sensor& sensor = data.options.sensor;
    const bool difference = sensor.type == models::Sensor::Type::angle_difference;
    const ObservedChannels channels(shooting_messages, data.system(), data.series);
    for (const ObservedCoordinate& o : data.observed) {
        if (difference && o.coordinate == static_cast<Index>(sensor.rate)) continue;  // read as an angle
        const auto index = static_cast<std::size_t>(&o - data.observed.data());
        estimator::Group group =
            channels.group(data.options.name, o.coordinate, index, data.options.errors, data.options.forms);
        // Rounding to steps: uniform errors of this sd at least (mathematics.md, "Instrument").
        const bool encoded = difference && o.coordinate == static_cast<Index>(sensor.angle) && sensor.step > 0.0;
        if (encoded && !group.factor) group.floor = std::max(group.floor, sensor.step / std::sqrt(12.0));
        if (group.scale.estimate && group.floor > 0.0) group.scale.value = std::max(group.scale.value, group.floor);
        if (!difference && data.series.sampling == Series::Sampling::samples) {
            group.ordered = true;
            const Segment& first = data.series.segments[data.options.segments.front()];
            const Index samples = first.times.size();
            group.interval =
                samples > 1 ? (first.times[samples - 1] - first.times[0]) / static_cast<double>(samples - 1) : 1.0;
        }
        initial_.groups.push_back(std::move(group));
    }
    if (!matching_.constraints) make_matching_groups();
}

void ShootingResidual::make_matching_groups() {
    const auto coordinates = data_->system().coordinates();
    const bool diffusion = matching_.kind == Continuity::Kind::diffusion;
    std::vector<Index> own = noisy_coordinates();
    for (Index i = 0; !diffusion && i < std::ssize(coordinates); ++i)
        own.push_back(i);
    for (const Index i : own) {
        const models::Coordinate& coordinate = coordinates[static_cast<std::size_t>(i)];
        estimator::Group group;
        group.name = fmt::format("{}.{}.{}", data_->options.name, diffusion ? "noise" : "matching", coordinate.name);
        group.unit = diffusion ? root_diffusion_unit(coordinate.unit) : std::string(coordinate.unit);
        group.scale.estimate = matching_.estimate;
        group.slack = matching_.kind == Continuity::Kind::exact || matching_.estimate;
        // Exact matching is approached with Student's t: as its sd falls below what defects need, both are the same.
        if (matching_.kind == Continuity::Kind::exact || matching_.kind == Continuity::Kind::student_t)
            group.distribution = estimator::StudentErrors{{false, matching_.dof, estimator::FlatPrior{}}};
        initial_.groups.push_back(std::move(group));
    }
}

void ShootingResidual::make_layout() {
    const Data& data = *data_;
    const Index n = data.system().dimension();
    const auto first = static_cast<int>(data.reading_range.size());
    const bool sized = std::any_of(data.options.forms.begin(), data.options.forms.end(),
                                   [](const ErrorForm& form) { return is_sized(form.distribution); });
    const bool known_sds = std::any_of(data.observed.begin(), data.observed.end(),
                                       [](const ObservedCoordinate& o) { return o.known_sds; });
    std::vector<estimator::BlockLayout> layout;
    layout.reserve(data.plan.nodes.size());
    for (std::size_t b = 0; b < data.plan.nodes.size(); ++b) {
        const PlannedNode& node = data.plan.nodes[b];
        const auto readings = data.plan.of(b);
        estimator::BlockLayout block;
        block.label = fmt::format("{}:{}", data.series.segments[node.segment].label, node.sample);
        block.latents = n;
        for (const PlannedReading& reading : readings)
            block.group.push_back(reading.group);
        if (node.linked) {
            block.next = static_cast<std::ptrdiff_t>(b) + 1;
            if (matching_.constraints) {
                block.constraints = n;
                block.constraint_size = data.range;
            } else {
                block.linked_from = std::ssize(block.group);
                for (Index i = 0; !noise_ && i < n; ++i)
                    block.group.push_back(first + static_cast<int>(i));
                if (noise_) set_link_errors(b, block);
            }
        }
        if (known_sds) {
            if (block.deviation.size() == 0) block.deviation = VectorXd::Ones(std::ssize(block.group));
            for (std::size_t r = 0; r < readings.size(); ++r)
                block.deviation[static_cast<Index>(r)] = readings[r].deviation;
        }
        if (sized) {
            block.observed = VectorXd::Zero(std::ssize(block.group));
            for (std::size_t r = 0; r < readings.size(); ++r)
                block.observed[static_cast<Index>(r)] = readings[r].value;
        }
        layout.push_back(std::move(block));
    }
    initial_.layout = std::move(layout);
}

}  // namespace orbid::orbits
