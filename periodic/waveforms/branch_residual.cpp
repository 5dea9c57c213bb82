#include "periodic/waveforms/branch_residual.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>
#include <variant>

#include <fmt/format.h>
#include <oneapi/tbb/parallel_for.h>

#include "models/definition/parameter.hpp"
#include "models/definition/wrong_data.hpp"
#include "models/system/left_loop.hpp"
#include "periodic/orbit/eigen_names.hpp"
#include "periodic/orbit/full_turn.hpp"
#include "periodic/solution/solve_orbit.hpp"

namespace orbid::periodic {
namespace {

void require_call(bool rule, const std::string& message) {
    if (!rule) throw std::invalid_argument("branch residual: " + message);
}

/// Rounds in which all orbits are sought anew, so that an estimate ends.
constexpr double most_rounds = 4;
/// An orbit resembles a motion where their measures differ by less than half, on root mean square. A motion near a fold
/// that the model has not reached has no orbit, and is not to be taken for another one.
constexpr double resembling = 0.25;
/// Measures are compared with their own size, but for those below this share of the channel's: means near 0.
constexpr double smallest_share = 0.1;
/// Another orbit is taken where it leaves less than this share of the misfit: at a fold two orbits differ by little.
constexpr double better = 1.0 - 1e-9;
constexpr double rounded_misfit = 1e-20;  // by which those of exact data differ

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
    find_starts(options_.start);
}

void BranchResidual::check_channels() const {
    const auto& channels = options_.channels;
    require_call(!channels.empty(), "at least one channel is needed");
    for (auto channel = channels.begin(); channel != channels.end(); ++channel) {
        require_call(channel->coordinate >= 0 && channel->coordinate < system_->dimension(),
                     fmt::format("channel of coordinate {}: model {} has {}", channel->coordinate, system_->name(),
                                 system_->dimension()));
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

estimator::Group BranchResidual::make_group(const BranchChannel& channel) const {
    estimator::Group group;
    group.name = options_.name + "." + name_of(channel.measure);
    group.unit = "Hz";
    if (channel.measure != OrbitMeasure::frequency) {
        const models::Coordinate& coordinate = system_->coordinates()[static_cast<std::size_t>(channel.coordinate)];
        group.name = fmt::format("{}.{}.{}", options_.name, coordinate.name, name_of(channel.measure));
        group.unit = coordinate.unit;
    }
    if (channel.known_sds || is_log_normal(channel)) group.unit = "1";
    group.scale = channel.scale;
    group.distribution = channel.distribution;
    group.floor = channel.floor;
    group.factor = channel.known_sds;
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
    return layout;
}

double BranchResidual::misfit(std::size_t block, const estimator::BlockValue& value) const {
    const auto measured = sources(block);
    double sum = 0.0;
    for (std::size_t r = 0; r < measured.size(); ++r) {
        const auto c = static_cast<Index>(measured[r]);
        const double e = value.e(static_cast<Index>(r));
        const double own = orbits_[block].values(c) * orbits_[block].values(c);
        const double mean = spread_(c) / static_cast<double>(orbits_.size());
        // A measure that is 0 everywhere has no size to be compared with.
        const double size = std::max(own, smallest_share * smallest_share * mean);
        if (size > 0.0) sum += e * e / size;
    }
    return sum / static_cast<double>(measured.size());
}

SteadyStateResidual::FoundStart BranchResidual::find_start(std::size_t b, const VectorXd& theta) const {
    return best_of(b, orbits_[b].starts, theta);
}

int BranchResidual::seek_again(estimator::ActiveSet& active, const VectorXd& theta) const {
    double& rounds = active.memory.back()[1];
    if (!options_.starts || rounds >= most_rounds) return 0;
    ++rounds;
    const auto starts = options_.starts(theta);
    std::vector<unsigned char> changed(orbits_.size(), 0);
    tbb::parallel_for(std::size_t{0}, std::min(starts.size(), orbits_.size()), [&](std::size_t b) {
        const Known before = known(active, b);
        FoundStart found = best_of(b, starts[b], theta);
        if (found.known.status != OrbitStatus::converged) return;
        double present = std::numeric_limits<double>::infinity();
        if (active.layout[b].active) {
            const PeriodicOrbit orbit = solve(b, before, theta, false);
            if (orbit.status == OrbitStatus::converged) {
                const estimator::BlockValue errors = value(b, before, orbit, theta, {}, false);
                if (errors.status == estimator::BlockStatus::ok) present = misfit(b, errors);
            }
        }
        // The same orbit again has the same misfit, to rounding.
        if (!(found.misfit < better * present - rounded_misfit)) return;
        found.known.taken_back = before.taken_back;
        remember(active, b, found.known);
        active.layout[b].active = true;
        changed[b] = 1;
    });
    models::stop_if_left();
    return static_cast<int>(std::count(changed.begin(), changed.end(), 1));
}

SteadyStateResidual::FoundStart BranchResidual::best_of(std::size_t b, const std::vector<StartingSolution>& starts,
                                                        const VectorXd& theta) const {
    FoundStart best;
    best.misfit = std::numeric_limits<double>::infinity();
    const VectorXd values = binding(b).values(theta);
    for (const StartingSolution& start : starts) {
        ShootingOptions options;
        options.flow = following().flow;
        options.maximum_distance = std::numeric_limits<double>::infinity();
        FoundStart found;
        found.known.orbit = solve_orbit(*system_, values, start, {}, options);
        found.known.status = found.known.orbit.status;
        if (found.known.status != OrbitStatus::converged) continue;
        // The size of the orbit, as its points show it: never 0.
        const MatrixXd& points = found.known.orbit.points;
        found.known.scale = points.rowwise().norm() / std::sqrt(static_cast<double>(points.cols()));
        const OrbitReadings along(*system_, values, found.known.orbit, {}, std::nullopt, following().flow);
        if (!along.simulated()) continue;
        for (Index i = 0; i < points.rows(); ++i) {
            const auto range = along.measure(OrbitMeasure::half_range, i);
            const auto rms = along.measure(OrbitMeasure::rms, i);
            const double size = range ? std::max(range->value, rms->value) : full_turn;
            found.known.scale(i) = size > 0.0 ? size : 1.0;
        }
        found.known.orbit.sensitivities.resize(0, 0);
        const PeriodicOrbit solved = solve_near(b, found.known, theta, true);
        if (solved.status != OrbitStatus::converged) continue;
        keep(found.known, b, solved, theta);
        const estimator::BlockValue errors = value(b, found.known, solved, theta, {}, false);
        if (errors.status != estimator::BlockStatus::ok) continue;
        found.misfit = misfit(b, errors);
        if (found.misfit < resembling && found.misfit < best.misfit) best = std::move(found);
    }
    return best;
}

estimator::BlockValue BranchResidual::value(std::size_t b, const Known& /*known*/, const PeriodicOrbit& orbit,
                                            const VectorXd& theta, const VectorXd& /*latents*/,
                                            bool derivatives) const {
    const VectorXd values = binding(b).values(theta);
    const std::span<const Index> free(binding(b).parameter);
    const OrbitReadings along(*system_, values, orbit, options_.sensor,
                              derivatives ? std::optional<std::span<const Index>>(free) : std::nullopt,
                              following().flow);
    if (!along.simulated()) return failed();
    const auto measured = sources(b);
    estimator::BlockValue result;
    result.e.resize(std::ssize(measured));
    MatrixXd by_parameter(derivatives ? result.e.size() : 0, std::ssize(free));
    for (std::size_t r = 0; r < measured.size(); ++r) {
        const BranchChannel& channel = options_.channels[measured[r]];
        const auto predicted = along.measure(channel.measure, channel.coordinate);
        if (!predicted) return failed();
        const auto row = static_cast<Index>(r);
        result.e(row) = orbits_[b].values(static_cast<Index>(measured[r])) - predicted->value;
        if (derivatives) by_parameter.row(row) = -predicted->by_parameters;
    }
    if (derivatives) {
        result.e_theta = binding(b).spread(by_parameter);
        result.e_z.resize(result.e.size(), 0);
    }
    if (!result.e.allFinite() || !result.e_theta.allFinite()) return failed();
    return result;
}

}  // namespace orbid::periodic
