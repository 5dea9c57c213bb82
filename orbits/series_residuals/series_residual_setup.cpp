#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <variant>

#include <fmt/format.h>

#include "models/arithmetic/median.hpp"
#include "orbits/series_residuals/observed_channels.hpp"
#include "orbits/series_residuals/series_residual.hpp"

namespace orbid::orbits {
namespace {

/// Sampling intervals of fitted segments may differ by this share, as times within one may: the group has one interval.
constexpr double interval_tolerance = 0.05;

double median_interval(const Segment& segment) {
    std::vector<double> steps;
    for (Eigen::Index k = 1; k < segment.times.size(); ++k)
        steps.push_back(segment.times[k] - segment.times[k - 1]);
    return models::upper_median(std::move(steps));
}

}  // namespace

SeriesResidual::SeriesResidual(std::shared_ptr<const models::System> system, models::ParameterBinding binding,
                               Series series, SeriesResidualOptions options)
    : system_(std::move(system)),
      binding_(std::move(binding)),
      series_(std::move(series)),
      options_(std::move(options)) {
    if (system_ == nullptr) throw std::invalid_argument("series residual: a system is needed");
    require(series_.sampling == Series::Sampling::samples, "the series holds sections; samples in time are needed");
    channels().check_clock();
    check_binding();
    check_rules();
    choose_coordinates();
    choose_segments();
    give_inputs();
    check_forms();
    make_groups();
    for (const std::size_t s : options_.segments) {
        blocks_.push_back(make_block(s));
        layout_.push_back(make_layout(blocks_.back()));
    }
    check_covariances();
}

void SeriesResidual::require(bool rule, const std::string& message) const {
    channels().require(rule, "{}", message);
}

void SeriesResidual::require_call(bool rule, const std::string& message) const {
    channels().require_call(rule, "{}", message);
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
    require_call(rules.empty() || std::ssize(rules) == system_->dimension(),
                 fmt::format("{} rules for the initial state, the model has {} coordinates", rules.size(),
                             system_->dimension()));
    for (std::size_t i = 0; i < rules.size(); ++i) {
        const auto name = system_->coordinates()[i].name;
        require_call(std::isfinite(rules[i].value), fmt::format("initial {}: value must be a finite number", name));
        require_call(!rules[i].start || std::isfinite(*rules[i].start),
                     fmt::format("initial {}: start must be a finite number", name));
        require_call(
            rules[i].kind != InitialStateRule::Kind::normal || (rules[i].sd > 0.0 && std::isfinite(rules[i].sd)),
            fmt::format("initial {}: sd of the prior is {}, must be > 0", name, rules[i].sd));
        for (const Eigen::Index parameter : rules[i].parameters) {
            require_call(parameter >= 0 && parameter < binding_.estimated_count,
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
            require_call(group >= 0 && group < static_cast<int>(observed_.size()),
                         fmt::format("full covariance: there is no observed coordinate {}", group));
        }
        for (const Block& block : blocks_) {
            std::vector<std::vector<Eigen::Index>> samples(covariance.groups.size());
            for (std::size_t r = 0; r < block.records.size(); ++r) {
                for (std::size_t k = 0; k < covariance.groups.size(); ++k)
                    if (block.group[r] == covariance.groups[k]) samples[k].push_back(block.records[r].sample);
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
    if (options_.delay) {
        channels().check_delay(*options_.delay, binding_, options_.inputs, options_.sensor);
        require(options_.sensor.type != models::Sensor::Type::angle_difference ||
                    delay_slopes(options_.delay, binding_).isZero(0.0),
                "the delay of the inputs cannot be estimated with an angle_difference sensor over whole segments: its "
                "reading depends on the delay; use nodes");
    }
    with_inputs_ = channels().with_inputs(options_.inputs, options_.sensor, options_.delay);
}

void SeriesResidual::choose_coordinates() {
    for (const ObservedCoordinate& o : channels().chosen(options_.observe)) {
        row_.push_back(o.row);
        observed_.push_back(o.coordinate);
    }
    using Kind = InitialStateRule::Kind;
    for (Eigen::Index i = 0; i < system_->dimension(); ++i) {
        const Kind kind =
            options_.initial.empty() ? Kind::estimate : options_.initial[static_cast<std::size_t>(i)].kind;
        if (kind == Kind::estimate || kind == Kind::normal) free_.push_back(i);
        if (kind == Kind::normal) priors_.push_back(i);
        if (kind == Kind::parameter) given_.push_back(i);
    }
}

void SeriesResidual::choose_segments() {
    auto& chosen = options_.segments;
    channels().choose_segments(chosen);
    for (const std::size_t s : chosen) {
        const Segment& segment = series_.segments[s];
        require_call(segment.values.rows() == series_.dimension() && segment.times.size() == segment.values.cols(),
                     fmt::format("segment {}: values and times do not fit the series", segment.label));
        const double interval = median_interval(segment);
        if (s == chosen.front()) interval_ = interval;
        require(std::abs(interval - interval_) <= interval_tolerance * interval_,
                fmt::format("segment {} is sampled every {} s, the first one every {} s; one interval is needed",
                            segment.label, interval, interval_));
    }
    for (const Eigen::Index i : given_) {
        const auto& parameters = options_.initial[static_cast<std::size_t>(i)].parameters;
        require_call(
            parameters.size() == chosen.size(),
            fmt::format("initial {}: {} parameters for {} segments",
                        system_->coordinates()[static_cast<std::size_t>(i)].name, parameters.size(), chosen.size()));
    }
}

void SeriesResidual::make_groups() {
    channels().check_count(options_.errors.size(), "scales", observed_.size());
    for (std::size_t i = 0; i < observed_.size(); ++i) {
        estimator::Group group = channels().group(options_.name, observed_[i], i, options_.errors, options_.forms);
        if (std::holds_alternative<estimator::LogNormalErrors>(group.distribution)) group.unit = "1";
        group.ordered = true;
        group.interval = interval_;
        groups_.push_back(std::move(group));
    }
    for (const Eigen::Index i : priors_) {
        const models::Coordinate& coordinate = system_->coordinates()[static_cast<std::size_t>(i)];
        estimator::Group group;
        group.name = fmt::format("{}.initial.{}", options_.name, coordinate.name);
        group.unit = coordinate.unit;
        group.scale.estimate = false;
        group.scale.value = options_.initial[static_cast<std::size_t>(i)].sd;
        groups_.push_back(std::move(group));
    }
}

SeriesResidual::Block SeriesResidual::make_block(std::size_t segment) const {
    const Segment& data = series_.segments[segment];
    Block block;
    block.segment = segment;
    std::vector<double> observed;
    std::vector<double> deviation;
    for (std::size_t i = 0; i < observed_.size(); ++i) {
        for (Eigen::Index k = 0; k < data.values.cols(); ++k) {
            if (!std::isfinite(data.values(row_[i], k))) continue;
            block.records.push_back({observed_[i], k});
            block.rows.push_back(row_[i]);
            block.group.push_back(static_cast<int>(i));
            observed.push_back(data.values(row_[i], k));
            deviation.push_back(known_sd(data, i, k));
        }
    }
    require(std::ssize(block.records) + std::ssize(priors_) >= std::max<std::ptrdiff_t>(std::ssize(free_), 1) &&
                !block.records.empty(),
            fmt::format("segment {} has {} samples, fewer than the {} coordinates of its initial state", data.label,
                        block.records.size(), free_.size()));
    for (std::size_t i = 0; i < priors_.size(); ++i) {
        block.records.push_back({priors_[i], -1});
        block.rows.push_back(-1);
        block.group.push_back(static_cast<int>(observed_.size() + i));
        observed.push_back(options_.initial[static_cast<std::size_t>(priors_[i])].value);
        deviation.push_back(1.0);
    }
    block.observed = Eigen::Map<const Eigen::VectorXd>(observed.data(), std::ssize(observed));
    block.deviation = Eigen::Map<const Eigen::VectorXd>(deviation.data(), std::ssize(deviation));
    return block;
}

/// The sd of the k-th reading of an observed coordinate, 1 where the form does not ask for it.
double SeriesResidual::known_sd(const Segment& data, std::size_t observed, Eigen::Index k) const {
    if (options_.forms.empty()) return 1.0;
    const ErrorForm& form = options_.forms[observed];
    channels().check_reading(form, data, row_[observed], k);
    if (!form.known_sds) return 1.0;
    return channels().known_sd(data, row_[observed], k);
}

estimator::BlockLayout SeriesResidual::make_layout(const Block& block) const {
    estimator::BlockLayout layout;
    layout.label = fmt::format("{}, segment {}", options_.name, series_.segments[block.segment].label);
    layout.group = block.group;
    layout.latents = std::ssize(free_);
    for (const ErrorForm& form : options_.forms) {
        if (form.known_sds) layout.deviation = block.deviation;
        if (is_sized(form.distribution)) layout.observed = block.observed;
    }
    return layout;
}

}  // namespace orbid::orbits
