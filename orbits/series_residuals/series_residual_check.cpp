#include <cmath>
#include <stdexcept>
#include <variant>

#include <fmt/format.h>

#include "orbits/records/error_form.hpp"
#include "orbits/series_residuals/observed_channels.hpp"
#include "orbits/series_residuals/series_residual.hpp"

namespace orbid::orbits {

void SeriesResidual::require(bool rule, const std::string& message) const {
    channels().require(rule, message);
}

ObservedChannels SeriesResidual::channels() const {
    return {"series residual", *system_, series_};
}

void SeriesResidual::check_binding() const {
    channels().check_binding(binding_, options_.start);
    if (options_.sensor.type == models::Sensor::Type::angle_difference &&
        !frequency_slopes(*system_, binding_).isZero(0.0)) {
        require(false,
                "the frequency of the forcing cannot be estimated with an angle_difference sensor: its reading depends "
                "on the phase; hold the frequency, or observe the angle with the state sensor");
    }
}

void SeriesResidual::check_rules() const {
    const auto& rules = options_.initial;
    require(rules.empty() || std::ssize(rules) == system_->dimension(),
            fmt::format("{} rules for the initial state, the model has {} coordinates", rules.size(),
                        system_->dimension()));
    for (std::size_t i = 0; i < rules.size(); ++i) {
        const auto name = system_->coordinates()[i].name;
        require(std::isfinite(rules[i].value), fmt::format("initial {}: value must be a finite number", name));
        require(!rules[i].start || std::isfinite(*rules[i].start),
                fmt::format("initial {}: start must be a finite number", name));
        require(rules[i].kind != InitialStateRule::Kind::normal || (rules[i].sd > 0.0 && std::isfinite(rules[i].sd)),
                fmt::format("initial {}: sd of the prior is {}, must be > 0", name, rules[i].sd));
        for (const Eigen::Index parameter : rules[i].parameters) {
            require(parameter >= 0 && parameter < binding_.estimated_count,
                    fmt::format("initial {}: no such estimated parameter", name));
        }
    }
}

void SeriesResidual::check_forms() const {
    channels().check_count(options_.forms.size(), "distributions", observed_.size());
    for (std::size_t i = 0; i < options_.forms.size(); ++i) {
        const ErrorForm& form = options_.forms[i];
        channels().check_form(form, options_.sensor, observed_[i]);
        require(!form.known_sds || !is_sized(form.distribution),
                fmt::format("errors of {}: known sds go with normal, Student's t, Laplace or autoregressive errors",
                            system_->coordinates()[static_cast<std::size_t>(observed_[i])].name));
    }
}

void SeriesResidual::check_covariances() const {
    for (const estimator::JointCovariance& covariance : options_.covariances) {
        for (const int group : covariance.groups) {
            require(group >= 0 && group < static_cast<int>(observed_.size()),
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
                require(
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
    with_inputs_ = channels().with_inputs(signals);
    // Rounding of times is forgiven, as the flow does.
    constexpr double slack = 1e-12;
    for (std::size_t s = 0; s < signals.size(); ++s) {
        const Segment& segment = series_.segments[s];
        if (segment.times.size() == 0) continue;
        const bool difference = options_.sensor.type == models::Sensor::Type::angle_difference;
        const double first = segment.times[0];
        const double last = segment.times[segment.times.size() - 1] + (difference ? options_.sensor.delay : 0.0);
        const double room = slack * (std::abs(first) + std::abs(last));
        require(signals[s]->first_time() <= first + room && last <= signals[s]->last_time() + room,
                fmt::format("segment {}: the measured inputs cover [{}, {}] s, not the [{}, {}] s that are read",
                            segment.label, signals[s]->first_time(), signals[s]->last_time(), first, last));
    }
}

}  // namespace orbid::orbits
