#include <algorithm>
#include <cmath>
#include <numeric>
#include <stdexcept>
#include <variant>

#include <fmt/format.h>

#include "orbits/series_residuals/shooting_residual.hpp"
#include "orbits/simulation/node_state.hpp"
#include "orbits/simulation/phase_rate.hpp"
#include "orbits/simulation/transition.hpp"

namespace orbid::orbits {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

void require_shooting(bool rule, const std::string& message) {
    if (!rule) throw std::invalid_argument("shooting residual: " + message);
}

/// d omega / d(parameter) for the estimated parameters: a difference of the model's own period, which in the models we
/// know is omega itself (slope 1) or does not move at all.
VectorXd omega_slopes(const models::System& system, const models::ParameterBinding& binding) {
    VectorXd slopes = VectorXd::Zero(std::ssize(binding.parameter));
    if (system.kind() != models::Kind::forced) return slopes;
    for (std::size_t j = 0; j < binding.parameter.size(); ++j) {
        VectorXd above = binding.base, below = binding.base;
        const Index parameter = binding.parameter[j];
        const double h = 1e-5 * std::abs(binding.base[parameter]);
        above[parameter] += h;
        below[parameter] -= h;
        if (h > 0.0)
            slopes[static_cast<Index>(j)] = (phase_rate(system, above) - phase_rate(system, below)) / (2.0 * h);
    }
    // Central differences of omega carry rounding; a slope is 1 or 0.
    for (double& slope : slopes)
        if (std::abs(slope - std::round(slope)) < 1e-6) slope = std::round(slope);
    return slopes;
}

void check_binding(const models::System& system, const models::ParameterBinding& binding, const VectorXd& start) {
    const auto q = std::ssize(system.parameters());
    require_shooting(binding.base.size() == q,
                     fmt::format("base has {} parameters, model {} has {}", binding.base.size(), system.name(), q));
    require_shooting(binding.parameter.size() == binding.estimated.size(),
                     "binding: parameter and estimated must have equal lengths");
    for (std::size_t i = 0; i < binding.parameter.size(); ++i) {
        require_shooting(binding.parameter[i] >= 0 && binding.parameter[i] < q,
                         "binding: no such parameter of the model");
        require_shooting(binding.estimated[i] >= 0 && binding.estimated[i] < binding.estimated_count,
                         "binding: no such estimated parameter");
    }
    require_shooting(start.size() == 0 || start.size() == binding.estimated_count,
                     fmt::format("start has {} entries, must have {} or none", start.size(), binding.estimated_count));
}

void choose_segments(const Series& series, std::vector<std::size_t>& chosen) {
    if (chosen.empty()) {
        chosen.resize(series.segments.size());
        std::iota(chosen.begin(), chosen.end(), std::size_t{0});
    }
    require_shooting(!chosen.empty(), "the series has no segment");
    for (auto s = chosen.begin(); s != chosen.end(); ++s) {
        require_shooting(*s < series.segments.size(),
                         fmt::format("segment {} does not exist; the series has {}", *s, series.segments.size()));
        require_shooting(std::find(chosen.begin(), s, *s) == s, fmt::format("segment {} is named twice", *s));
        const Segment& segment = series.segments[*s];
        require_shooting(segment.values.rows() == series.dimension() && segment.values.cols() > 0 &&
                             (segment.times.size() == 0 || segment.times.size() == segment.values.cols()),
                         fmt::format("segment {}: values and times do not fit the series", segment.label));
        require_shooting(segment.values.array().isFinite().any(),
                         fmt::format("segment {} has no reading", segment.label));
    }
}

std::vector<ObservedCoordinate> choose_coordinates(const models::System& system, const Series& series,
                                                   ShootingOptions& options) {
    if (options.observe.empty())
        for (const SeriesCoordinate& coordinate : series.coordinates)
            options.observe.push_back(coordinate.name);
    require_shooting(!options.observe.empty(), "at least one coordinate must be observed");
    std::vector<ObservedCoordinate> observed;
    for (const std::string& name : options.observe) {
        const auto found = std::find_if(series.coordinates.begin(), series.coordinates.end(),
                                        [&](const SeriesCoordinate& c) { return c.name == name; });
        require_shooting(found != series.coordinates.end(), fmt::format("the series has no coordinate {}", name));
        const Index index = system.coordinate_index(name);
        require_shooting(index >= 0, fmt::format("model {} has no coordinate {}", system.name(), name));
        require_shooting(std::none_of(observed.begin(), observed.end(),
                                      [&](const ObservedCoordinate& o) { return o.coordinate == index; }),
                         fmt::format("coordinate {} is observed twice", name));
        observed.push_back({found - series.coordinates.begin(), index, 0, false});
    }
    const models::Sensor& sensor = options.sensor;
    const bool difference = sensor.type == models::Sensor::Type::angle_difference;
    int groups = 0;
    int angle_group = -1;
    for (ObservedCoordinate& o : observed) {
        if (difference && o.coordinate == static_cast<Index>(sensor.rate)) continue;
        if (o.coordinate == static_cast<Index>(sensor.angle)) angle_group = groups;
        o.group = groups++;
    }
    require_shooting(!difference || angle_group >= 0, "the angle of an angle_difference sensor must be observed");
    for (ObservedCoordinate& o : observed)
        if (difference && o.coordinate == static_cast<Index>(sensor.rate)) o.group = angle_group;
    const std::size_t count = observed.size();
    require_shooting(options.errors.empty() || options.errors.size() == count,
                     fmt::format("{} error scales for {} observed coordinates", options.errors.size(), count));
    require_shooting(options.forms.empty() || options.forms.size() == count,
                     fmt::format("{} error distributions for {} observed coordinates", options.forms.size(), count));
    return observed;
}

void check_forms(const models::System& system, const ShootingOptions& options,
                 std::vector<ObservedCoordinate>& observed) {
    const bool difference = options.sensor.type == models::Sensor::Type::angle_difference;
    for (std::size_t i = 0; i < options.forms.size(); ++i) {
        const ErrorForm& form = options.forms[i];
        const auto index = static_cast<std::size_t>(observed[i].coordinate);
        const auto name = system.coordinates()[index].name;
        require_shooting(
            !is_sized(form.distribution) || !models::reads_angle(options.sensor, system.coordinates(), index),
            fmt::format("errors of {}: an angle has no size that log-normal or relative errors could refer to", name));
        require_shooting(!is_sized(form.distribution) || !form.known_sds,
                         fmt::format("errors of {}: known sds go with normal, Student's t or Laplace errors", name));
        require_shooting(!std::holds_alternative<estimator::AutoregressiveErrors>(form.distribution),
                         fmt::format("errors of {}: autoregressive errors would begin anew at every node; "
                                     "use one initial state per segment",
                                     name));
        require_shooting(
            !form.known_sds || !difference,
            fmt::format("errors of {}: readings of a difference sensor have one error, that of its angle", name));
        observed[i].known_sds = form.known_sds;
    }
}

void check_known_sds(const Series& series, const ShootingOptions& options,
                     const std::vector<ObservedCoordinate>& observed) {
    for (const ObservedCoordinate& o : observed) {
        if (!o.known_sds) continue;
        for (const std::size_t s : options.segments) {
            const Segment& data = series.segments[s];
            const bool there =
                data.deviations.rows() == data.values.rows() && data.deviations.cols() == data.values.cols();
            for (Index k = 0; k < data.values.cols(); ++k) {
                if (!std::isfinite(data.values(o.row, k))) continue;
                require_shooting(there && data.deviations(o.row, k) > 0.0 && std::isfinite(data.deviations(o.row, k)),
                                 fmt::format("segment {}: reading {} of {} has no known sd > 0", data.label, k,
                                             series.coordinates[static_cast<std::size_t>(o.row)].name));
            }
        }
    }
}

}  // namespace

void ShootingResidual::check_matching() const {
    const Index n = data_->system().dimension();
    require_shooting(matching_.sd.size() == 0 || matching_.sd.size() == n,
                     fmt::format("{} matching sds for {} coordinates", matching_.sd.size(), n));
    for (const double sd : matching_.sd)
        require_shooting(sd > 0.0 && std::isfinite(sd), fmt::format("a matching sd is {}, must be > 0", sd));
    require_shooting(matching_.kind == Continuity::Kind::exact || matching_.estimate || matching_.sd.size() > 0,
                     "matching with an error of its own needs its sds, or to estimate them");
    require_shooting(!matching_.estimate || matching_.kind != Continuity::Kind::exact,
                     "exact matching has no sd that could be estimated: choose normal or Student's t");
    require_shooting(!matching_.constraints || matching_.kind == Continuity::Kind::exact,
                     "only exact matching can be done by constraints");
}

std::shared_ptr<ShootingResidual::Data> ShootingResidual::read(std::shared_ptr<const models::System> system,
                                                               models::ParameterBinding binding, Series series,
                                                               ShootingOptions options) {
    require_shooting(system != nullptr, "a system is needed");
    check_binding(*system, binding, options.start);
    const bool sections = series.sampling == Series::Sampling::section;
    require_shooting(sections || system->kind() != models::Kind::map,
                     fmt::format("model {} is a map and predicts no samples in time", system->name()));
    require_shooting(!sections || system->kind() != models::Kind::autonomous || series.timed(),
                     fmt::format("crossings of the autonomous model {} need their times", system->name()));
    require_shooting(options.interval >= 0,
                     fmt::format("interval is {}, must be > 0, or 0 to be chosen", options.interval));
    choose_segments(series, options.segments);
    auto data = std::make_shared<Data>();
    data->observed = choose_coordinates(*system, series, options);
    check_forms(*system, options, data->observed);
    check_known_sds(series, options, data->observed);
    data->instant_sensor = options.sensor;
    if (options.sensor.type == models::Sensor::Type::angle_difference)
        data->instant_sensor.type = models::Sensor::Type::state;
    require_shooting(options.inputs.empty() || !system->inputs().empty(),
                     fmt::format("model {} reads no measured inputs", system->name()));
    require_shooting(options.inputs.size() == (system->inputs().empty() ? 0 : series.segments.size()),
                     fmt::format("model {} reads measured inputs: {} signals for {} segments", system->name(),
                                 options.inputs.size(), series.segments.size()));
    for (const auto& signal : options.inputs)
        data->systems.push_back(system->with_input(signal));
    if (options.inputs.empty()) data->systems.push_back(system);
    data->omega_slopes = omega_slopes(*system, binding);
    data->binding = std::move(binding);
    data->series = std::move(series);
    data->options = std::move(options);
    return data;
}

void ShootingResidual::make_groups() {
    const Data& data = *data_;
    const models::Sensor& sensor = data.options.sensor;
    const bool difference = sensor.type == models::Sensor::Type::angle_difference;
    for (const ObservedCoordinate& o : data.observed) {
        if (difference && o.coordinate == static_cast<Index>(sensor.rate)) continue;  // read as an angle
        const auto index = static_cast<std::size_t>(&o - data.observed.data());
        const models::Coordinate& coordinate = data.system().coordinates()[static_cast<std::size_t>(o.coordinate)];
        estimator::Group group;
        group.name = fmt::format("{}.{}", data.options.name, coordinate.name);
        group.unit = coordinate.unit;
        group.scale.value = 0.0;  // from the readings
        if (!data.options.errors.empty()) group.scale = data.options.errors[index];
        if (!data.options.forms.empty()) {
            const ErrorForm& form = data.options.forms[index];
            group.distribution = form.distribution;
            group.floor = form.floor;
            group.factor = form.known_sds;
            if (form.known_sds) group.unit = "1";
        }
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
        groups_.push_back(std::move(group));
    }
    if (matching_.constraints) return;
    for (const models::Coordinate& coordinate : data.system().coordinates()) {
        estimator::Group group;
        group.name = fmt::format("{}.matching.{}", data.options.name, coordinate.name);
        group.unit = coordinate.unit;
        group.scale.estimate = matching_.estimate;
        // Exact matching is approached with Student's t: as its sd falls below what defects need, both are the same.
        if (matching_.kind != Continuity::Kind::normal)
            group.distribution = estimator::StudentErrors{{false, matching_.dof, estimator::FlatPrior{}}};
        groups_.push_back(std::move(group));
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
    layout_.reserve(data.plan.nodes.size());
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
                for (Index i = 0; i < n; ++i)
                    block.group.push_back(first + static_cast<int>(i));
            }
        }
        if (known_sds) {
            block.deviation = VectorXd::Ones(std::ssize(block.group));
            for (std::size_t r = 0; r < readings.size(); ++r)
                block.deviation[static_cast<Index>(r)] = readings[r].deviation;
        }
        if (sized) {
            block.observed = VectorXd::Zero(std::ssize(block.group));
            for (std::size_t r = 0; r < readings.size(); ++r)
                block.observed[static_cast<Index>(r)] = readings[r].value;
        }
        layout_.push_back(std::move(block));
    }
}

}  // namespace orbid::orbits
