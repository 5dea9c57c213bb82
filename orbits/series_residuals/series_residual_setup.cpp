#include <algorithm>
#include <cmath>
#include <numeric>
#include <stdexcept>
#include <variant>

#include <fmt/format.h>

#include "orbits/series_residuals/series_residual.hpp"
#include "orbits/series_residuals/series_residual_rule.hpp"

namespace orbid::orbits {
namespace {

/// Sampling intervals of fitted segments may differ by this share, as times within one may: the group has one interval.
constexpr double interval_tolerance = 0.05;

double median_interval(const Segment& segment) {
    std::vector<double> steps;
    for (Eigen::Index k = 1; k < segment.times.size(); ++k)
        steps.push_back(segment.times[k] - segment.times[k - 1]);
    if (steps.empty()) return 0.0;
    const auto middle = steps.begin() + static_cast<std::ptrdiff_t>(steps.size() / 2);
    std::nth_element(steps.begin(), middle, steps.end());
    return *middle;
}

}  // namespace

SeriesResidual::SeriesResidual(std::shared_ptr<const models::System> system, models::ParameterBinding binding,
                               Series series, SeriesResidualOptions options)
    : system_(std::move(system)),
      binding_(std::move(binding)),
      series_(std::move(series)),
      options_(std::move(options)) {
    require_series_rule(system_ != nullptr, "a system is needed");
    require_series_rule(series_.sampling == Series::Sampling::samples,
                        "the series holds sections; samples in time are needed");
    require_series_rule(system_->kind() != models::Kind::map,
                        fmt::format("model {} is a map and predicts no samples in time", system_->name()));
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

void SeriesResidual::choose_coordinates() {
    if (options_.observe.empty()) {
        for (const SeriesCoordinate& coordinate : series_.coordinates)
            options_.observe.push_back(coordinate.name);
    }
    require_series_rule(!options_.observe.empty(), "at least one coordinate must be observed");
    for (const std::string& name : options_.observe) {
        const auto found = std::find_if(series_.coordinates.begin(), series_.coordinates.end(),
                                        [&](const SeriesCoordinate& c) { return c.name == name; });
        require_series_rule(found != series_.coordinates.end(), fmt::format("the series has no coordinate {}", name));
        const Eigen::Index index = system_->coordinate_index(name);
        require_series_rule(index >= 0, fmt::format("model {} has no coordinate {}", system_->name(), name));
        require_series_rule(std::find(observed_.begin(), observed_.end(), index) == observed_.end(),
                            fmt::format("coordinate {} is observed twice", name));
        row_.push_back(found - series_.coordinates.begin());
        observed_.push_back(index);
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
    if (chosen.empty()) {
        chosen.resize(series_.segments.size());
        std::iota(chosen.begin(), chosen.end(), std::size_t{0});
    }
    require_series_rule(!chosen.empty(), "the series has no segment");
    for (auto s = chosen.begin(); s != chosen.end(); ++s) {
        require_series_rule(*s < series_.segments.size(),
                            fmt::format("segment {} does not exist; the series has {}", *s, series_.segments.size()));
        require_series_rule(std::find(chosen.begin(), s, *s) == s, fmt::format("segment {} is named twice", *s));
        const Segment& segment = series_.segments[*s];
        require_series_rule(
            segment.values.rows() == series_.dimension() && segment.times.size() == segment.values.cols(),
            fmt::format("segment {}: values and times do not fit the series", segment.label));
        const double interval = median_interval(segment);
        if (s == chosen.begin()) interval_ = interval;
        require_series_rule(
            std::abs(interval - interval_) <= interval_tolerance * interval_,
            fmt::format("segment {} is sampled every {} s, the first one every {} s; one interval is needed",
                        segment.label, interval, interval_));
    }
    for (const Eigen::Index i : given_) {
        const auto& parameters = options_.initial[static_cast<std::size_t>(i)].parameters;
        require_series_rule(
            parameters.size() == chosen.size(),
            fmt::format("initial {}: {} parameters for {} segments",
                        system_->coordinates()[static_cast<std::size_t>(i)].name, parameters.size(), chosen.size()));
    }
}

void SeriesResidual::make_groups() {
    require_series_rule(
        options_.errors.empty() || options_.errors.size() == observed_.size(),
        fmt::format("{} error scales for {} observed coordinates", options_.errors.size(), observed_.size()));
    for (std::size_t i = 0; i < observed_.size(); ++i) {
        const models::Coordinate& coordinate = system_->coordinates()[static_cast<std::size_t>(observed_[i])];
        estimator::Group group;
        group.name = fmt::format("{}.{}", options_.name, coordinate.name);
        group.unit = coordinate.unit;
        group.scale.value = 0.0;  // from the residuals
        if (!options_.errors.empty()) group.scale = options_.errors[i];
        if (!options_.forms.empty()) {
            const ErrorForm& form = options_.forms[i];
            group.distribution = form.distribution;
            group.floor = form.floor;
            group.factor = form.known_sds;
            const bool relative_sd = std::holds_alternative<estimator::LogNormalErrors>(form.distribution);
            if (form.known_sds || relative_sd) group.unit = "1";
        }
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
    require_series_rule(
        std::ssize(block.records) + std::ssize(priors_) >= std::max<std::ptrdiff_t>(std::ssize(free_), 1) &&
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
    const double reading = data.values(row_[observed], k);
    const auto name = system_->coordinates()[static_cast<std::size_t>(observed_[observed])].name;
    if (std::holds_alternative<estimator::LogNormalErrors>(form.distribution)) {
        require_series_rule(
            reading > 0.0, fmt::format("segment {}: log-normal errors of {}: reading {} is {}, must be > 0", data.label,
                                       name, k, reading));
    }
    if (!form.known_sds) return 1.0;
    const bool there = data.deviations.rows() == data.values.rows() && data.deviations.cols() == data.values.cols();
    const double sd = there ? data.deviations(row_[observed], k) : 0.0;
    require_series_rule(sd > 0.0 && std::isfinite(sd),
                        fmt::format("segment {}: reading {} of {} has no known sd > 0", data.label, k, name));
    return sd;
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
