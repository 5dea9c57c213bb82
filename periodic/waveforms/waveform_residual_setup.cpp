#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>
#include <utility>
#include <variant>

#include <fmt/format.h>

#include "models/arithmetic/median.hpp"
#include "models/definition/wrong_data.hpp"
#include "periodic/orbit/eigen_names.hpp"
#include "periodic/waveforms/waveform_residual.hpp"

namespace orbid::periodic {

namespace {

constexpr int longest_period = 64;
/// Sampling intervals may differ by this fraction where errors are autoregressive: the correlation belongs to one
/// interval.
constexpr double interval_tolerance = 0.05;
/// A record covers an orbit when the samples and the interval after the last reach this fraction of it: T of an
/// autonomous flow is a guess.
constexpr double covered_share = 0.9;

void require(bool rule, const std::string& message) {
    if (!rule) throw std::invalid_argument("waveform residual: " + message);
}

/// The same of the data.
void require_of_record(bool rule, const std::string& message) {
    if (!rule) throw models::DataError("waveform residual: " + message);
}

double median_interval(const VectorXd& times) {
    std::vector<double> steps;
    for (Index k = 1; k < times.size(); ++k)
        steps.push_back(times(k) - times(k - 1));
    return models::upper_median(std::move(steps));
}

bool is_sized(const estimator::ErrorDistribution& distribution) {
    return std::holds_alternative<estimator::LogNormalErrors>(distribution) ||
           std::holds_alternative<estimator::RelativeErrors>(distribution);
}

bool is_autoregressive(const WaveformChannel& channel) {
    return std::holds_alternative<estimator::AutoregressiveErrors>(channel.distribution);
}

/// @param need  throws with the name of the record.
template <class Need>
void check_start(const models::System& system, const models::ParameterBinding& binding, const VectorXd& start,
                 const Need& need) {
    const auto q = std::ssize(system.parameters());
    require(binding.base.size() == q,
            fmt::format("binding: {} values, model {} has {} parameters", binding.base.size(), system.name(), q));
    require(binding.parameter.size() == binding.estimated.size(), "binding: lists of different lengths");
    require(start.size() == binding.estimated_count,
            fmt::format("{} parameters at the start, must be {}", start.size(), binding.estimated_count));
    for (std::size_t i = 0; i < binding.parameter.size(); ++i) {
        require(binding.parameter[i] >= 0 && binding.parameter[i] < q, "binding: no such parameter of the model");
        require(binding.estimated[i] >= 0 && binding.estimated[i] < binding.estimated_count,
                "binding: no such estimated parameter");
    }
    const VectorXd theta = binding.values(start);
    for (Index i = 0; i < q; ++i) {
        const auto& parameter = system.parameters()[static_cast<std::size_t>(i)];
        need(models::contains(parameter.domain, theta(i)),
             fmt::format("{} starts at {}, must be {}", parameter.name, theta(i), models::rule(parameter.domain)));
    }
}

}  // namespace

WaveformResidual::WaveformResidual(std::shared_ptr<const models::System> system, std::vector<WaveformRecord> records,
                                   WaveformOptions options)
    : SteadyStateResidual(std::move(system), {options.maximum_move, options.flow}),
      records_(std::move(records)),
      options_(std::move(options)) {
    check_model();
    check_channels();
    require(!records_.empty(), "at least one record is needed");
    for (const WaveformRecord& record : records_) {
        check_record(record);
        check_readings(record);
        blocks_.push_back(make_block(record));
        add_block(record.binding, make_layout(record, blocks_.back()));
    }
    make_groups();
    check_covariances();
    find_starts(options_.start);
}

void WaveformResidual::check_model() const {
    require(system_ != nullptr, "a system is needed");
    require(system_->kind() != models::Kind::map,
            fmt::format("model {} is a map and has no waveforms in time", system_->name()));
    require(system_->inputs().empty(),
            fmt::format("model {} reads measured inputs: its steady states are not periodic by themselves",
                        system_->name()));
    require(options_.maximum_move > 0.0, fmt::format("maximum_move is {}, must be > 0", options_.maximum_move));
}

void WaveformResidual::check_channels() const {
    const auto& channels = options_.channels;
    require(!channels.empty(), "at least one channel is needed");
    for (auto channel = channels.begin(); channel != channels.end(); ++channel) {
        require(channel->coordinate >= 0 && channel->coordinate < system_->dimension(),
                fmt::format("channel of coordinate {}: model {} has {}", channel->coordinate, system_->name(),
                            system_->dimension()));
        const auto name = system_->coordinates()[static_cast<std::size_t>(channel->coordinate)].name;
        require(std::none_of(channels.begin(), channel,
                             [&](const auto& other) { return other.coordinate == channel->coordinate; }),
                fmt::format("coordinate {} is read by two channels", name));
        require(!channel->known_sds || !is_sized(channel->distribution),
                fmt::format("{}: known sds go with errors that do not depend on the size of the reading", name));
    }
}

void WaveformResidual::check_record(const WaveformRecord& record) const {
    const auto need = [&](bool rule, const std::string& message) {
        require_of_record(rule, record.label + ": " + message);
    };
    check_start(*system_, record.binding, options_.start, need);
    const VectorXd theta = record.binding.values(options_.start);
    const auto channels = std::ssize(options_.channels);
    const Index count = record.times.size();
    need(count >= 2, fmt::format("{} samples, needed are 2 or more", count));
    need(record.values.rows() == channels && record.values.cols() == count,
         fmt::format("values have shape ({}, {}), must be ({}, {}): channels, times", record.values.rows(),
                     record.values.cols(), channels, count));
    for (Index k = 0; k < count; ++k) {
        need(std::isfinite(record.times(k)), fmt::format("time {} is not a finite number", k));
        need(k == 0 || record.times(k) > record.times(k - 1),
             fmt::format("times must ascend: {} s follows {} s", record.times(k), k > 0 ? record.times(k - 1) : 0.0));
    }
    need(!record.values.array().isInf().any(), "values must be finite, or nan where a sample is missing");

    double length = record.time;
    if (system_->kind() == models::Kind::autonomous) {
        need(record.time > 0.0 && std::isfinite(record.time),
             fmt::format("time is {} s: model {} is autonomous, a guess > 0 of its period is needed", record.time,
                         system_->name()));
        need(record.period == 1, fmt::format("period is {}: that of an autonomous model is 1", record.period));
        need(record.phase.estimate, fmt::format("the phase of model {} is unknown by nature: nothing drives it; it "
                                                "must be estimated",
                                                system_->name()));
    } else {
        need(record.time == 0.0, fmt::format("time is {} s: model {} is forced, its orbits last whole periods",
                                             record.time, system_->name()));
        need(record.period >= 1 && record.period <= longest_period,
             fmt::format("period is {}, must lie in [1, {}]", record.period, longest_period));
        const double turn = 2.0 * std::numbers::pi * record.period;
        need(record.phase.estimate || std::abs(record.phase.value) <= turn,
             fmt::format("phase is {} rad, must lie within +- {} rad, the whole orbit", record.phase.value, turn));
        length = record.period * system_->period(theta, models::Clock::time);
    }
    const double span = record.times(count - 1) - record.times(0) + median_interval(record.times);
    need(span >= covered_share * length, fmt::format("lasts {:.4g} s, its orbit {:.4g} s: at least one whole orbit is "
                                                     "needed",
                                                     span, length));
    need(record.offsets.empty() || std::ssize(record.offsets) == channels,
         fmt::format("{} offsets for {} channels", record.offsets.size(), channels));
    for (const WaveformUnknown& offset : record.offsets)
        need(offset.estimate || std::isfinite(offset.value), "a known offset must be a finite number");
    for (const WaveformChannel& channel : options_.channels) {
        if (!is_autoregressive(channel)) continue;
        const double first = median_interval(records_.front().times);
        for (Index k = 1; k < count; ++k) {
            const double interval = record.times(k) - record.times(k - 1);
            need(std::abs(interval - first) <= interval_tolerance * first,
                 fmt::format("autoregressive errors need one sampling interval: {} s beside {} s", interval, first));
        }
    }
}

void WaveformResidual::check_readings(const WaveformRecord& record) const {
    const auto need = [&](bool rule, const std::string& message) {
        require_of_record(rule, record.label + ": " + message);
    };
    const bool sds = record.deviations.size() > 0;
    need(!sds || (record.deviations.rows() == record.values.rows() && record.deviations.cols() == record.values.cols()),
         "known sds must have the shape of the values");
    Index unknowns = record.phase.estimate ? 1 : 0;
    for (std::size_t c = 0; c < options_.channels.size(); ++c) {
        const WaveformChannel& channel = options_.channels[c];
        const auto name = system_->coordinates()[static_cast<std::size_t>(channel.coordinate)].name;
        const auto row = record.values.row(static_cast<Index>(c));
        const bool angle =
            models::reads_angle(record.sensor, system_->coordinates(), static_cast<std::size_t>(channel.coordinate));
        need(!is_sized(channel.distribution) || !angle,
             fmt::format("{} is an angle: its errors cannot be relative to its size", name));
        const auto readings = (row.array() == row.array()).count();
        const bool offset = !record.offsets.empty() && record.offsets[c].estimate;
        if (offset) ++unknowns;
        need(!offset || readings > 0, fmt::format("the offset of {} is unknown and it has no reading", name));
        for (Index k = 0; k < row.size(); ++k) {
            if (std::isnan(row(k))) continue;
            need(!std::holds_alternative<estimator::LogNormalErrors>(channel.distribution) || row(k) > 0.0,
                 fmt::format("log-normal errors of {}: reading {} is {}, must be > 0; \"normal\" and \"relative\" "
                             "errors allow others",
                             name, k, row(k)));
            if (!channel.known_sds) continue;
            const double sd = sds ? record.deviations(static_cast<Index>(c), k) : 0.0;
            need(sd > 0.0 && std::isfinite(sd), fmt::format("reading {} of {} has no known sd > 0", k, name));
        }
    }
    const auto readings = (record.values.array() == record.values.array()).count();
    need(readings > unknowns, fmt::format("{} readings for {} unknown phase and offsets", readings, unknowns));
}

void WaveformResidual::check_covariances() const {
    for (const estimator::JointCovariance& covariance : options_.covariances) {
        for (const int group : covariance.groups) {
            require(group >= 0 && group < static_cast<int>(options_.channels.size()),
                    fmt::format("covariance: there is no channel {}", group));
            for (const WaveformRecord& record : records_) {
                const auto first = record.values.row(covariance.groups.front()).array();
                const auto other = record.values.row(group).array();
                require_of_record(
                    ((first == first) == (other == other)).all(),
                    fmt::format("{}: channels with a full covariance must be read at the same samples", record.label));
            }
        }
    }
}

void WaveformResidual::make_groups() {
    for (const WaveformChannel& channel : options_.channels) {
        const models::Coordinate& coordinate = system_->coordinates()[static_cast<std::size_t>(channel.coordinate)];
        estimator::Group group;
        group.name = fmt::format("{}.{}", options_.name, coordinate.name);
        group.unit = coordinate.unit;
        group.scale = channel.scale;
        group.distribution = channel.distribution;
        group.floor = channel.floor;
        group.factor = channel.known_sds;
        if (channel.known_sds || std::holds_alternative<estimator::LogNormalErrors>(channel.distribution))
            group.unit = "1";
        group.ordered = true;
        group.interval = median_interval(records_.front().times);
        initial_.groups.push_back(std::move(group));
    }
}

WaveformResidual::Block WaveformResidual::make_block(const WaveformRecord& record) const {
    Block block;
    for (Index c = 0; c < record.values.rows(); ++c)
        for (Index k = 0; k < record.values.cols(); ++k)
            if (std::isfinite(record.values(c, k))) block.sources.push_back({c, k});
    if (record.phase.estimate) block.unknowns.push_back(-1);
    for (std::size_t c = 0; c < record.offsets.size(); ++c)
        if (record.offsets[c].estimate) block.unknowns.push_back(static_cast<Index>(c));
    return block;
}

estimator::BlockLayout WaveformResidual::make_layout(const WaveformRecord& record, const Block& block) const {
    estimator::BlockLayout layout;
    layout.label = fmt::format("{}, {}", options_.name, record.label);
    layout.latents = std::ssize(block.unknowns);
    const auto& channels = options_.channels;
    const bool sds = std::any_of(channels.begin(), channels.end(), [](const auto& c) { return c.known_sds; });
    const bool sized =
        std::any_of(channels.begin(), channels.end(), [](const auto& c) { return is_sized(c.distribution); });
    if (sds) layout.deviation.resize(std::ssize(block.sources));
    if (sized) layout.observed.resize(std::ssize(block.sources));
    for (std::size_t r = 0; r < block.sources.size(); ++r) {
        const Source& source = block.sources[r];
        layout.group.push_back(static_cast<int>(source.channel));
        const bool known = channels[static_cast<std::size_t>(source.channel)].known_sds;
        if (sds)
            layout.deviation(static_cast<Index>(r)) = known ? record.deviations(source.channel, source.sample) : 1.0;
        if (sized) layout.observed(static_cast<Index>(r)) = record.values(source.channel, source.sample);
    }
    return layout;
}

}  // namespace orbid::periodic
