#include "orbits/series_residuals/observed_channels.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include <fmt/format.h>

#include "orbits/records/refusal.hpp"

namespace orbid::orbits {

using Eigen::Index;

void ObservedChannels::refuse(bool call, const std::string& message) const {
    refuse_if(call, "{}: {}", who_, message);
    throw DataError(fmt::format("{}: {}", who_, message));
}

void ObservedChannels::check_binding(const models::ParameterBinding& binding, const Eigen::VectorXd& start) const {
    const auto q = std::ssize(system_.parameters());
    require_call(binding.base.size() == q, "base has {} parameters, model {} has {}", binding.base.size(),
                 system_.name(), q);
    require_call(binding.parameter.size() == binding.estimated.size(),
                 "binding: parameter and estimated must have equal lengths");
    for (std::size_t i = 0; i < binding.parameter.size(); ++i) {
        require_call(binding.parameter[i] >= 0 && binding.parameter[i] < q, "binding: no such parameter of the model");
        require_call(binding.estimated[i] >= 0 && binding.estimated[i] < binding.estimated_count,
                     "binding: no such estimated parameter");
    }
    require_call(start.size() == 0 || start.size() == binding.estimated_count,
                 "start has {} entries, must have {} or none", start.size(), binding.estimated_count);
}

void ObservedChannels::check_clock() const {
    require(series_.sampling == Series::Sampling::section || system_.kind() != models::Kind::map,
            "model {} is a map and predicts no samples in time", system_.name());
}

std::vector<ObservedCoordinate> ObservedChannels::chosen(std::vector<std::string>& names) const {
    if (names.empty())
        for (const SeriesCoordinate& coordinate : series_.coordinates)
            names.push_back(coordinate.name);
    require_call(!names.empty(), "at least one coordinate must be observed");
    std::vector<ObservedCoordinate> observed;
    for (const std::string& name : names) {
        const auto found = std::find_if(series_.coordinates.begin(), series_.coordinates.end(),
                                        [&](const SeriesCoordinate& c) { return c.name == name; });
        require(found != series_.coordinates.end(), "the series has no coordinate {}", name);
        const Index index = system_.coordinate_index(name);
        require_call(index >= 0, "model {} has no coordinate {}", system_.name(), name);
        require_call(std::none_of(observed.begin(), observed.end(),
                                  [&](const ObservedCoordinate& o) { return o.coordinate == index; }),
                     "coordinate {} is observed twice", name);
        observed.push_back({found - series_.coordinates.begin(), index, 0, false});
    }
    return observed;
}

void ObservedChannels::check_count(std::size_t errors, std::string_view what, std::size_t observed) const {
    require_call(errors == 0 || errors == observed, "{} error {} for {} observed coordinates", errors, what, observed);
}

void ObservedChannels::choose_segments(std::vector<std::size_t>& segments) const {
    const std::size_t count = series_.segments.size();
    if (segments.empty()) {
        segments.resize(count);
        std::iota(segments.begin(), segments.end(), std::size_t{0});
    }
    require(!segments.empty(), "the series has no segment");
    for (auto s = segments.begin(); s != segments.end(); ++s) {
        require_call(*s < count, "segment {} does not exist; the series has {}", *s, count);
        require_call(std::find(segments.begin(), s, *s) == s, "segment {} is named twice", *s);
    }
}

void ObservedChannels::check_form(const ErrorForm& form, const models::Sensor& sensor, Index coordinate) const {
    const auto index = static_cast<std::size_t>(coordinate);
    require(!is_sized(form.distribution) || !models::reads_angle(sensor, system_.coordinates(), index),
            "errors of {}: an angle has no size that log-normal or relative errors could refer to",
            system_.coordinates()[index].name);
}

std::vector<std::shared_ptr<const models::System>> ObservedChannels::with_inputs(
    const std::vector<std::shared_ptr<const models::InputSignal>>& signals, const models::Sensor& sensor,
    const std::optional<InputDelay>& delay) const {
    require(signals.empty() || !system_.inputs().empty(), "model {} reads no measured inputs", system_.name());
    require_call(signals.size() == (system_.inputs().empty() ? 0 : series_.segments.size()),
                 "model {} reads measured inputs: {} signals for {} segments", system_.name(), signals.size(),
                 series_.segments.size());
    // Rounding of times is forgiven, as the flow does.
    constexpr double slack = 1e-12;
    const double second = sensor.type == models::Sensor::Type::angle_difference ? sensor.delay : 0.0;
    for (std::size_t s = 0; s < signals.size(); ++s) {
        const Segment& segment = series_.segments[s];
        if (segment.times.size() == 0) continue;
        const double first = segment.times[0] - (delay ? delay->upper : 0.0);
        const double last = segment.times[segment.times.size() - 1] + second - (delay ? delay->lower : 0.0);
        const double room = slack * (std::abs(first) + std::abs(last));
        require(signals[s]->first_time() <= first + room && last <= signals[s]->last_time() + room,
                "segment {}: the measured inputs cover [{}, {}] s, not the [{}, {}] s that are read{}", segment.label,
                signals[s]->first_time(), signals[s]->last_time(), first, last,
                delay ? fmt::format(" with delays in [{}, {}] s: choose narrower bounds, or a window that leaves out "
                                    "the ends of the record",
                                    delay->lower, delay->upper)
                      : "");
    }
    std::vector<std::shared_ptr<const models::System>> systems;
    for (const auto& signal : signals)
        systems.push_back(system_.with_input(signal));
    return systems;
}

void ObservedChannels::check_delay(const InputDelay& delay, const models::ParameterBinding& binding,
                                   const std::vector<std::shared_ptr<const models::InputSignal>>& signals,
                                   const models::Sensor& sensor) const {
    require_call(delay.parameter >= 0 && delay.parameter < std::ssize(system_.parameters()),
                 "delay of the inputs: no such parameter of the model");
    const std::string_view name = system_.parameters()[static_cast<std::size_t>(delay.parameter)].name;
    require(!system_.inputs().empty(), "{}: model {} reads no inputs that could be delayed", name, system_.name());
    require(std::isfinite(delay.lower) && std::isfinite(delay.upper),
            "{}, the delay of the inputs, needs bounds on both sides: the inputs must cover what is read between them",
            name);
    if (delay_slopes(delay, binding).isZero(0.0)) return;
    const bool held = std::any_of(signals.begin(), signals.end(), [](const auto& signal) {
        return signal->interpolation() == models::InputSignal::Interpolation::held;
    });
    require(!held,
            "{}, the delay of the inputs, cannot be estimated where they are held: an input that jumps has no "
            "derivative by its delay; interpolate linearly, by cubics or band-limited",
            name);
    // Names of a formula: coordinates, parameters, inputs.
    const std::size_t first_input = system_.coordinates().size() + system_.parameters().size();
    for (const models::FunctionReading& reading : sensor.functions) {
        const auto& used = reading.expression.used();
        require(used.empty() || used.back() < first_input,
                "{}, the delay of the inputs, cannot be estimated where a formula of the sensor reads an input", name);
    }
}

void ObservedChannels::check_reading(const ErrorForm& form, const Segment& segment, Index row, Index sample) const {
    const double reading = segment.values(row, sample);
    require(!std::holds_alternative<estimator::LogNormalErrors>(form.distribution) || reading > 0.0,
            "segment {}: log-normal errors of {}: reading {} is {}, must be > 0; \"normal\" and \"relative\" errors "
            "allow others",
            segment.label, series_.coordinate(row).name, sample, reading);
}

double ObservedChannels::known_sd(const Segment& segment, Index row, Index sample) const {
    const Eigen::MatrixXd& sds = segment.deviations;
    const bool there = sds.rows() == segment.values.rows() && sds.cols() == segment.values.cols();
    const double sd = there ? sds(row, sample) : 0.0;
    require(sd > 0.0 && std::isfinite(sd), "segment {}: reading {} of {} has no known sd > 0", segment.label, sample,
            series_.coordinate(row).name);
    return sd;
}

estimator::Group ObservedChannels::group(const std::string& residual, Index coordinate, std::size_t place,
                                         const std::vector<estimator::ErrorScale>& scales,
                                         const std::vector<ErrorForm>& forms) const {
    const models::Coordinate& observed = system_.coordinates()[static_cast<std::size_t>(coordinate)];
    estimator::Group group;
    group.name = fmt::format("{}.{}", residual, observed.name);
    group.unit = observed.unit;
    group.scale.value = 0.0;
    if (!scales.empty()) group.scale = scales[place];
    if (forms.empty()) return group;
    group.distribution = forms[place].distribution;
    group.floor = forms[place].floor;
    group.factor = forms[place].known_sds;
    if (group.factor) group.unit = "1";
    return group;
}

Eigen::VectorXd delay_slopes(const std::optional<InputDelay>& delay, const models::ParameterBinding& binding) {
    Eigen::VectorXd slopes = Eigen::VectorXd::Zero(std::ssize(binding.parameter));
    for (std::size_t j = 0; j < binding.parameter.size(); ++j)
        if (delay && binding.parameter[j] == delay->parameter) slopes[static_cast<Index>(j)] = 1.0;
    return slopes;
}

Eigen::VectorXd frequency_slopes(const models::System& system, const models::ParameterBinding& binding) {
    Eigen::VectorXd slopes = Eigen::VectorXd::Zero(std::ssize(binding.parameter));
    const auto frequency = system.forcing_frequency();
    for (std::size_t j = 0; j < binding.parameter.size(); ++j)
        if (frequency && binding.parameter[j] == *frequency) slopes[static_cast<Index>(j)] = 1.0;
    return slopes;
}

}  // namespace orbid::orbits
