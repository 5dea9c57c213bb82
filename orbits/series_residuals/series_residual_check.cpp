#include <cmath>
#include <stdexcept>
#include <variant>

#include <fmt/format.h>

#include "orbits/records/error_form.hpp"
#include "orbits/series_residuals/series_residual.hpp"
#include "orbits/series_residuals/series_residual_rule.hpp"

namespace orbid::orbits {
void SeriesResidual::check_binding() const {
    const auto q = std::ssize(system_->parameters());
    require_series_rule(binding_.base.size() == q, fmt::format("base has {} parameters, model {} has {}",
                                                               binding_.base.size(), system_->name(), q));
    require_series_rule(binding_.parameter.size() == binding_.estimated.size(),
                        "binding: parameter and estimated must have equal lengths");
    for (std::size_t i = 0; i < binding_.parameter.size(); ++i) {
        require_series_rule(binding_.parameter[i] >= 0 && binding_.parameter[i] < q,
                            "binding: no such parameter of the model");
        require_series_rule(binding_.estimated[i] >= 0 && binding_.estimated[i] < binding_.estimated_count,
                            "binding: no such estimated parameter");
    }
    require_series_rule(
        options_.start.size() == 0 || options_.start.size() == binding_.estimated_count,
        fmt::format("start has {} entries, must have {} or none", options_.start.size(), binding_.estimated_count));
    if (options_.sensor.type == models::Sensor::Type::angle_difference && !omega_slopes(binding_.base).isZero(0.0)) {
        require_series_rule(
            false,
            "the frequency of the forcing cannot be estimated with an angle_difference sensor: its reading depends "
            "on the phase; hold the frequency, or observe the angle with the state sensor");
    }
}

void SeriesResidual::check_rules() const {
    const auto& rules = options_.initial;
    require_series_rule(rules.empty() || std::ssize(rules) == system_->dimension(),
                        fmt::format("{} rules for the initial state, the model has {} coordinates", rules.size(),
                                    system_->dimension()));
    for (std::size_t i = 0; i < rules.size(); ++i) {
        const auto name = system_->coordinates()[i].name;
        require_series_rule(std::isfinite(rules[i].value),
                            fmt::format("initial {}: value must be a finite number", name));
        require_series_rule(!rules[i].start || std::isfinite(*rules[i].start),
                            fmt::format("initial {}: start must be a finite number", name));
        require_series_rule(
            rules[i].kind != InitialStateRule::Kind::normal || (rules[i].sd > 0.0 && std::isfinite(rules[i].sd)),
            fmt::format("initial {}: sd of the prior is {}, must be > 0", name, rules[i].sd));
        for (const Eigen::Index parameter : rules[i].parameters) {
            require_series_rule(parameter >= 0 && parameter < binding_.estimated_count,
                                fmt::format("initial {}: no such estimated parameter", name));
        }
    }
}

void SeriesResidual::check_forms() const {
    require_series_rule(
        options_.forms.empty() || options_.forms.size() == observed_.size(),
        fmt::format("{} error distributions for {} observed coordinates", options_.forms.size(), observed_.size()));
    for (std::size_t i = 0; i < options_.forms.size(); ++i) {
        const models::Coordinate& coordinate = system_->coordinates()[static_cast<std::size_t>(observed_[i])];
        const ErrorForm& form = options_.forms[i];
        const auto index = static_cast<std::size_t>(observed_[i]);
        require_series_rule(
            !is_sized(form.distribution) || !models::reads_angle(options_.sensor, system_->coordinates(), index),
            fmt::format("errors of {}: an angle has no size that log-normal or relative errors could refer to",
                        coordinate.name));
        require_series_rule(
            !form.known_sds || !is_sized(form.distribution),
            fmt::format("errors of {}: known sds go with normal, Student's t, Laplace or autoregressive errors",
                        coordinate.name));
    }
}

void SeriesResidual::check_covariances() const {
    for (const estimator::JointCovariance& covariance : options_.covariances) {
        for (const int group : covariance.groups) {
            require_series_rule(group >= 0 && group < static_cast<int>(observed_.size()),
                                fmt::format("full covariance: there is no observed coordinate {}", group));
        }
        for (const Block& block : blocks_) {
            std::vector<std::vector<Eigen::Index>> samples(covariance.groups.size());
            for (std::size_t r = 0; r < block.records.size(); ++r) {
                for (std::size_t k = 0; k < covariance.groups.size(); ++k) {
                    if (block.group[r] == covariance.groups[k]) samples[k].push_back(block.records[r].sample);
                }
            }
            for (const auto& other : samples) {
                require_series_rule(
                    other == samples.front(),
                    fmt::format("segment {}: the coordinates of a full covariance must be read at the same samples; "
                                "here some of them are missing alone",
                                series_.segments[block.segment].label));
            }
        }
    }
}

void SeriesResidual::give_inputs() {
    const auto& signals = options_.inputs;
    require_series_rule(signals.empty() || !system_->inputs().empty(),
                        fmt::format("model {} reads no measured inputs", system_->name()));
    require_series_rule(signals.size() == (system_->inputs().empty() ? 0 : series_.segments.size()),
                        fmt::format("model {} reads measured inputs: {} signals for {} segments", system_->name(),
                                    signals.size(), series_.segments.size()));
    // Rounding of times is forgiven, as the flow does.
    constexpr double slack = 1e-12;
    for (std::size_t s = 0; s < signals.size(); ++s) {
        const Segment& segment = series_.segments[s];
        with_inputs_.push_back(system_->with_input(signals[s]));
        if (segment.times.size() == 0) continue;
        const bool difference = options_.sensor.type == models::Sensor::Type::angle_difference;
        const double first = segment.times[0];
        const double last = segment.times[segment.times.size() - 1] + (difference ? options_.sensor.delay : 0.0);
        const double room = slack * (std::abs(first) + std::abs(last));
        require_series_rule(
            signals[s]->first_time() <= first + room && last <= signals[s]->last_time() + room,
            fmt::format("segment {}: the measured inputs cover [{}, {}] s, not the [{}, {}] s that are read",
                        segment.label, signals[s]->first_time(), signals[s]->last_time(), first, last));
    }
}

}  // namespace orbid::orbits
