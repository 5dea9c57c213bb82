#include "periodic/waveforms/branch_residual.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>
#include <tuple>
#include <utility>
#include <variant>

#include <fmt/format.h>

#include "models/definition/parameter.hpp"
#include "models/definition/wrong_data.hpp"
#include "periodic/orbit/eigen_names.hpp"

namespace orbid::periodic {
namespace {

void require_call(bool rule, const std::string& message) {
    if (!rule) throw std::invalid_argument("branch residual: " + message);
}

bool is_log_normal(const BranchChannel& channel) {
    return std::holds_alternative<estimator::LogNormalErrors>(channel.distribution);
}

bool is_relative_to_size(const BranchChannel& channel) {
    return is_log_normal(channel) || std::holds_alternative<estimator::RelativeErrors>(channel.distribution);
}

bool same(const BranchChannel& a, const BranchChannel& b) {
    return a.measure == b.measure && (a.measure == OrbitMeasure::frequency || a.coordinate == b.coordinate);
}

}  // namespace

const std::string& name_of(OrbitMeasure measure) {
    static const std::array<std::string, 6> names{"max", "min", "mean", "half_range", "rms", "frequency"};
    return names[static_cast<std::size_t>(measure)];
}

BranchResidual::BranchResidual(std::shared_ptr<const models::System> system, std::vector<MeasuredOrbit> orbits,
                               BranchOptions options)
    : SteadyStateResidual(std::move(system), {options.maximum_move, options.flow}),
      orbits_(std::move(orbits)),
      options_(std::move(options)) {
    require_call(system_ != nullptr, "a system is needed");
    require_call(system_->kind() != models::Kind::map,
                 fmt::format("model {} is a map: its cycles are data of their own", system_->name()));
    require_call(system_->inputs().empty(),
                 fmt::format("model {} reads measured inputs: its steady states are not periodic by themselves",
                             system_->name()));
    require_call(options_.parameter_sd >= 0.0 && std::isfinite(options_.parameter_sd),
                 fmt::format("parameter_sd is {}, must be >= 0 and finite", options_.parameter_sd));
    require_call(
        !moves_parameter() || (options_.parameter >= 0 && options_.parameter < std::ssize(system_->parameters())),
        fmt::format("parameter {}: model {} has {}", options_.parameter, system_->name(),
                    system_->parameters().size()));
    require_call(options_.maximum_move > 0.0, fmt::format("maximum_move is {}, must be > 0", options_.maximum_move));
    check_channels();
    require_call(!orbits_.empty(), "at least one motion is needed");
    spread_ = VectorXd::Zero(std::ssize(options_.channels));
    for (const MeasuredOrbit& orbit : orbits_) {
        check_orbit(orbit);
        for (Index c = 0; c < spread_.size(); ++c)
            if (std::isfinite(orbit.values(c))) spread_(c) += orbit.values(c) * orbit.values(c);
    }
    for (std::size_t b = 0; b < orbits_.size(); ++b)
        add_block(orbits_[b].binding, make_layout(b));
    for (const BranchChannel& channel : options_.channels)
        initial_.groups.push_back(make_group(channel));
    if (moves_parameter()) initial_.groups.push_back(make_parameter_group());
    find_starts(options_.start);
}

void BranchResidual::check_channels() const {
    const auto& channels = options_.channels;
    require_call(!channels.empty(), "at least one channel is needed");
    const Index readings = system_->dimension() + std::ssize(options_.readings);
    for (auto channel = channels.begin(); channel != channels.end(); ++channel) {
        require_call(channel->coordinate >= 0 && channel->coordinate < readings,
                     fmt::format("channel of coordinate {}: model {} has {}, formulas included", channel->coordinate,
                                 system_->name(), readings));
        require_call(std::none_of(channels.begin(), channel, [&](const auto& other) { return same(other, *channel); }),
                     fmt::format("{} of coordinate {} is measured by two channels", name_of(channel->measure),
                                 channel->coordinate));
        require_call(!channel->known_sds || !is_relative_to_size(*channel),
                     "known sds go with errors that do not depend on the size of the measure");
        require_call(!std::holds_alternative<estimator::AutoregressiveErrors>(channel->distribution),
                     "measures of different motions are no course in time: their errors cannot be autoregressive");
    }
}

void BranchResidual::check_orbit(const MeasuredOrbit& orbit) const {
    const auto need = [&](bool rule, const std::string& message) {
        if (!rule) throw models::DataError(fmt::format("branch residual: {}: {}", orbit.label, message));
    };
    const auto q = std::ssize(system_->parameters());
    const auto channels = std::ssize(options_.channels);
    require_call(orbit.binding.base.size() == q && orbit.binding.parameter.size() == orbit.binding.estimated.size() &&
                     orbit.binding.estimated_count == options_.start.size(),
                 fmt::format("{}: the binding does not fit model {} and the start", orbit.label, system_->name()));
    const VectorXd theta = orbit.binding.values(options_.start);
    for (Index i = 0; i < q; ++i) {
        const auto& parameter = system_->parameters()[static_cast<std::size_t>(i)];
        need(models::contains(parameter.domain, theta(i)),
             fmt::format("{} starts at {}, must be {}", parameter.name, theta(i), models::rule(parameter.domain)));
    }
    need(orbit.values.size() == channels, fmt::format("{} values, must be {}", orbit.values.size(), channels));
    need(orbit.deviations.size() == 0 || orbit.deviations.size() == channels,
         fmt::format("{} known sds, must be {}", orbit.deviations.size(), channels));
    need(!orbit.values.array().isInf().any(), "measures must be finite, or nan where they are missing");
    need((orbit.values.array() == orbit.values.array()).any(), "nothing is measured");
    for (Index c = 0; c < channels; ++c) {
        const BranchChannel& channel = options_.channels[static_cast<std::size_t>(c)];
        if (std::isnan(orbit.values(c))) continue;
        need(!is_log_normal(channel) || orbit.values(c) > 0.0,
             fmt::format("log-normal errors of {}, which must be > 0", orbit.values(c)));
        const double sd = orbit.deviations.size() > 0 ? orbit.deviations(c) : 0.0;
        need(!channel.known_sds || (sd > 0.0 && std::isfinite(sd)),
             fmt::format("{} has no known sd > 0", name_of(channel.measure)));
    }
}

std::pair<std::string, std::string> BranchResidual::quantity(const BranchChannel& channel) const {
    const std::string& measure = name_of(channel.measure);
    if (channel.measure == OrbitMeasure::frequency) return {measure, "Hz"};
    const Index n = system_->dimension();
    if (channel.coordinate >= n) {
        const OrbitReading& reading = options_.readings[static_cast<std::size_t>(channel.coordinate - n)];
        return {reading.name + "." + measure, reading.unit};
    }
    const models::Coordinate& coordinate = system_->coordinates()[static_cast<std::size_t>(channel.coordinate)];
    return {fmt::format("{}.{}", coordinate.name, measure), std::string(coordinate.unit)};
}

estimator::Group BranchResidual::make_group(const BranchChannel& channel) const {
    estimator::Group group;
    std::tie(group.name, group.unit) = quantity(channel);
    group.name = options_.name + "." + group.name;
    if (channel.known_sds || is_log_normal(channel)) group.unit = "1";
    group.scale = channel.scale;
    group.distribution = channel.distribution;
    group.floor = channel.floor;
    group.factor = channel.known_sds;
    return group;
}

estimator::Group BranchResidual::make_parameter_group() const {
    const models::Parameter& parameter = system_->parameters()[static_cast<std::size_t>(options_.parameter)];
    estimator::Group group;
    group.name = fmt::format("{}.{}", options_.name, parameter.name);
    group.unit = parameter.unit;
    group.scale = {false, options_.parameter_sd, estimator::FlatPrior{}};
    return group;
}

std::vector<std::size_t> BranchResidual::sources(std::size_t block) const {
    std::vector<std::size_t> measured;
    for (std::size_t c = 0; c < options_.channels.size(); ++c)
        if (std::isfinite(orbits_[block].values(static_cast<Index>(c)))) measured.push_back(c);
    return measured;
}

estimator::BlockLayout BranchResidual::make_layout(std::size_t block) const {
    estimator::BlockLayout layout;
    const MeasuredOrbit& orbit = orbits_[block];
    layout.label = fmt::format("{}, {}", options_.name, orbit.label);
    const auto measured = sources(block);
    const auto& channels = options_.channels;
    if (std::any_of(channels.begin(), channels.end(), [](const auto& c) { return c.known_sds; }))
        layout.deviation = VectorXd::Ones(std::ssize(measured));
    if (std::any_of(channels.begin(), channels.end(), is_relative_to_size))
        layout.observed.resize(std::ssize(measured));
    for (std::size_t r = 0; r < measured.size(); ++r) {
        const auto c = static_cast<Index>(measured[r]);
        layout.group.push_back(static_cast<int>(c));
        if (channels[measured[r]].known_sds) layout.deviation(static_cast<Index>(r)) = orbit.deviations(c);
        if (layout.observed.size() > 0) layout.observed(static_cast<Index>(r)) = orbit.values(c);
    }
    if (!moves_parameter()) return layout;
    layout.latents = 1;
    layout.group.push_back(static_cast<int>(channels.size()));
    const double at = orbit.binding.base(options_.parameter);
    for (VectorXd* known : {&layout.deviation, &layout.observed}) {
        if (known->size() == 0) continue;
        known->conservativeResize(known->size() + 1);
        known->tail(1)(0) = known == &layout.deviation ? 1.0 : at;
    }
    return layout;
}

estimator::BlockValue BranchResidual::value(std::size_t b, const Known& /*known*/, const FollowedOrbit& orbit,
                                            const VectorXd& theta, const VectorXd& latents, bool derivatives) const {
    const std::span<const Index> free(binding(b).parameter);
    const Measures predicted = measured(b, values_at(b, theta, orbit.parameter), orbit, free, derivatives);
    if (!predicted.found) return failed();
    const auto channels = sources(b);
    const auto count = std::ssize(channels);
    const auto f = std::ssize(free);
    estimator::BlockValue result;
    result.e.resize(count + latents.size());
    for (Index r = 0; r < count; ++r)
        result.e(r) =
            orbits_[b].values(static_cast<Index>(channels[static_cast<std::size_t>(r)])) - predicted.values(r);
    if (moves_parameter()) result.e(count) = orbits_[b].binding.base(options_.parameter) - orbit.parameter;
    if (derivatives) {
        MatrixXd slopes = -predicted.slopes;
        if (moves_parameter()) {
            slopes.conservativeResize(count + 1, Eigen::NoChange);
            slopes.bottomRows(1) = -orbit.parameter_sensitivities;
        }
        result.e_theta = binding(b).spread(slopes.leftCols(f));
        result.e_z = slopes.rightCols(latents.size());
    }
    if (!result.e.allFinite() || !result.e_theta.allFinite() || !result.e_z.allFinite()) return failed();
    return result;
}

}  // namespace orbid::periodic
