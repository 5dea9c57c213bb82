#include "orbits/shooting_residual.hpp"

#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <cassert>
#include <cmath>
#include <stdexcept>

#include <fmt/format.h>

#include "orbits/node_state.hpp"
#include "orbits/phase_rate.hpp"
#include "orbits/section_map.hpp"
#include "orbits/shooting_interval.hpp"
#include "orbits/transition.hpp"

namespace orbid::orbits {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using estimator::BlockStatus;
using estimator::BlockValue;

/// Nodes that are simulated together: some of one pattern.
struct ShootingResidual::Chunk {
    const InstantPattern* pattern;
    std::span<const std::size_t> nodes;
};

ShootingResidual::ShootingResidual(std::shared_ptr<const models::System> system, models::ParameterBinding binding,
                                   Series series, ShootingOptions options)
    : matching_(options.matching) {
    auto data = read(std::move(system), std::move(binding), std::move(series), std::move(options));
    const VectorXd all =
        data->options.start.size() > 0 ? data->binding.values(data->options.start) : data->binding.base;
    data->interval = data->options.interval > 0 ? data->options.interval
                                                : shooting_interval(data->systems, all, data->series,
                                                                    data->options.sensor, data->options.segments);
    data->plan = plan_shooting(data->system(), data->series, data->options.segments, data->observed,
                               data->options.sensor, data->interval);
    data_ = data;
    guess_nodes(all);
    MatrixXd states(data->system().dimension(), std::ssize(start_));
    for (std::size_t b = 0; b < start_.size(); ++b)
        states.col(static_cast<Index>(b)) = start_[b];
    data->range = coordinate_range(data->system(), data->series, states);
    for (const ObservedCoordinate& o : data->observed)
        if (o.group == std::ssize(data->reading_range)) data->reading_range.push_back(data->range[o.coordinate]);
    make_groups();
    make_layout();
    begin_matching(start_theta());
}

void ShootingResidual::guess_nodes(const VectorXd& all) {
    const Data& data = *data_;
    const auto& plan = data.plan;
    start_.resize(plan.nodes.size());
    for (std::size_t f = 0, b = 0; f < data.options.segments.size(); ++f) {
        const std::size_t s = data.options.segments[f];
        std::vector<Index> samples;
        for (std::size_t i = b; i < plan.nodes.size() && plan.nodes[i].segment == s; ++i)
            samples.push_back(plan.nodes[i].sample);
        MatrixXd states;
        if (data.options.nodes.empty()) {
            states = node_states(system_of(s), all, data.series, s, data.options.sensor, samples);
        } else {
            states = data.options.nodes.size() > f ? data.options.nodes[f] : MatrixXd();
            if (states.rows() != data.system().dimension() || states.cols() != std::ssize(samples))
                throw std::invalid_argument(
                    fmt::format("shooting residual: segment {} has {} nodes of {} coordinates, "
                                "given are {} of {}",
                                data.series.segments[s].label, samples.size(), data.system().dimension(), states.cols(),
                                states.rows()));
        }
        if (!states.allFinite())
            throw std::invalid_argument(fmt::format(
                "shooting residual: segment {}: readings do not tell the states: a section needs all coordinates of "
                "the model, samples one at least",
                data.series.segments[s].label));
        for (Index k = 0; k < states.cols(); ++k, ++b)
            start_[b] = states.col(k);
    }
}

ShootingResidual ShootingResidual::with(const Matching& matching, std::vector<VectorXd> latents,
                                        const VectorXd& theta) const {
    ShootingResidual other = *this;
    other.matching_ = matching;
    if (!latents.empty()) {
        assert(latents.size() == start_.size());
        other.start_ = std::move(latents);
    }
    other.groups_.clear();
    other.layout_.clear();
    other.make_groups();
    other.make_layout();
    for (std::size_t b = 0; b < layout_.size(); ++b)
        other.layout_[b].active = layout_[b].active;
    other.begin_matching(theta.size() > 0 ? theta : start_theta());
    return other;
}

std::vector<BlockValue> ShootingResidual::evaluate(const VectorXd& theta, const std::vector<VectorXd>& latents,
                                                   bool derivatives) const {
    assert(latents.size() == layout_.size());
    std::vector<BlockValue> values(layout_.size());
    const Data& data = *data_;
    const VectorXd all = data.binding.values(theta);
    const bool possible = in_domain(data.system(), all);
    // 1024 flows of some microseconds: enough for packs and threads, little memory in flight.
    constexpr std::size_t together = 1024;
    std::vector<Chunk> chunks;
    std::vector<std::vector<std::size_t>> active(data.plan.patterns.size());
    for (std::size_t p = 0; p < active.size(); ++p) {
        for (const std::size_t b : data.plan.patterns[p].nodes) {
            if (!layout_[b].active) continue;
            if (possible && latents[b].allFinite())
                active[p].push_back(b);
            else
                values[b].status = BlockStatus::failed;
        }
        const std::span<const std::size_t> nodes(active[p]);
        for (std::size_t first = 0; first < nodes.size(); first += together)
            chunks.push_back({&data.plan.patterns[p], nodes.subspan(first, std::min(together, nodes.size() - first))});
    }
    oneapi::tbb::parallel_for(std::size_t{0}, chunks.size(),
                              [&](std::size_t c) { evaluate(chunks[c], all, latents, derivatives, values); });
    return values;
}

/// As accurate as the present matching needs, so that steps of the integrator do not show: with a hundredth of its sd a
/// series of 42 754 sections stopped 0.1 sds of the length short of its minimum.
models::FlowOptions ShootingResidual::stage_flow() const {
    constexpr double share = 0.003;
    constexpr double roughest = 1e-7;
    models::FlowOptions flow = data_->options.flow;
    const double enough = matching_.constraints ? 0.0 : std::min(roughest, share * tightness_);
    flow.relative_tolerance = std::max(flow.relative_tolerance, enough);
    flow.absolute_tolerance = std::max(flow.absolute_tolerance, enough);
    return flow;
}

void ShootingResidual::evaluate(const Chunk& chunk, const VectorXd& all, const std::vector<VectorXd>& latents,
                                bool derivatives, std::vector<BlockValue>& values) const {
    const Data& data = *data_;
    const InstantPattern& pattern = *chunk.pattern;
    const models::System& system = system_of(pattern.input);
    const Index n = system.dimension();
    const auto f = std::ssize(data.binding.parameter);
    const Index d = derivatives ? n + f : 0;
    const auto count = std::ssize(chunk.nodes);
    const auto m = std::ssize(pattern.instants);
    const double omega = system.kind() == models::Kind::forced ? phase_rate(system, all) : 1.0;
    const double delay = data.options.sensor.delay * (data.plan.clock == models::Clock::phase ? omega : 1.0);

    // Instants in ascending order; delayed ones may overtake others.
    std::vector<double> durations(pattern.instants.size());
    std::vector<Index> order(pattern.instants.size());
    for (std::size_t j = 0; j < order.size(); ++j) {
        const Instant& instant = pattern.instants[j];
        durations[j] = instant.after + (instant.delayed ? delay : 0.0);
        order[j] = static_cast<Index>(j);
    }
    std::stable_sort(order.begin(), order.end(), [&](Index a, Index b) {
        return durations[static_cast<std::size_t>(a)] < durations[static_cast<std::size_t>(b)];
    });
    std::vector<double> ascending(durations.size());
    std::vector<Index> place(durations.size());
    for (std::size_t j = 0; j < order.size(); ++j) {
        ascending[j] = durations[static_cast<std::size_t>(order[j])];
        place[static_cast<std::size_t>(order[j])] = static_cast<Index>(j);
    }

    MatrixXd starts(n, count);
    std::vector<double> phases(chunk.nodes.size());
    for (Index k = 0; k < count; ++k) {
        const std::size_t b = chunk.nodes[static_cast<std::size_t>(k)];
        const PlannedNode& node = data.plan.nodes[b];
        starts.col(k) = latents[b];
        phases[static_cast<std::size_t>(k)] =
            phase_at(system, all, data.series, data.series.segments[node.segment], node.sample);
    }
    const std::optional<std::span<const Index>> free =
        derivatives ? std::optional<std::span<const Index>>(data.binding.parameter) : std::nullopt;
    std::vector<models::FlowResult> flows;
    if (m > 0) flows = system.flows(starts, phases, ascending, all, free, data.plan.clock, stage_flow());

    // States at all instants, the node's own first, and what the instrument reads there.
    MatrixXd states(n, count * (m + 1));
    std::vector<double> instant_phases(static_cast<std::size_t>(count * (m + 1)));
    std::vector<char> ok(chunk.nodes.size(), 1);
    for (Index k = 0; k < count; ++k) {
        const auto at = static_cast<std::size_t>(k);
        states.col(k * (m + 1)) = starts.col(k);
        if (m > 0) {
            ok[at] = flows[at].status == models::FlowStatus::ok && flows[at].states.allFinite() ? 1 : 0;
            for (Index j = 0; j < m; ++j)
                states.col(k * (m + 1) + 1 + j) =
                    ok[at] != 0 ? flows[at].states.col(place[static_cast<std::size_t>(j)]) : starts.col(k);
        }
        for (Index j = 0; j <= m; ++j) {
            const double after = j == 0 ? 0.0 : durations[static_cast<std::size_t>(j - 1)];
            const double rate = data.plan.clock == models::Clock::phase ? 1.0 : phase_rate(system, all);
            instant_phases[static_cast<std::size_t>(k * (m + 1) + j)] = phases[at] + rate * after;
        }
    }
    const auto read = system.readings(data.instant_sensor, states, instant_phases, all, free, data.options.flow);
    if (read.status != models::FlowStatus::ok && count > 1) {  // which one it is, each for itself tells
        for (std::size_t k = 0; k < chunk.nodes.size(); ++k)
            evaluate(Chunk{&pattern, chunk.nodes.subspan(k, 1)}, all, latents, derivatives, values);
        return;
    }
    // What an estimated frequency moves beside the flow: the phase of a node at a time, the instant of a second
    // reading.
    const bool moves = derivatives && !data.omega_slopes.isZero(0.0);
    MatrixXd rates;
    if (moves) rates = system.rhs(states, instant_phases, all);

    MatrixXd sensitivity(n, d);
    Eigen::RowVectorXd total(d);
    for (Index k = 0; k < count; ++k) {
        const auto at = static_cast<std::size_t>(k);
        const std::size_t b = chunk.nodes[at];
        const PlannedNode& node = data.plan.nodes[b];
        BlockValue& value = values[b];
        if (ok[at] == 0 || read.status != models::FlowStatus::ok) {
            value.status = BlockStatus::failed;
            continue;
        }
        const auto readings = data.plan.of(b);
        const auto records = std::ssize(readings);
        const bool linked = node.linked && !matching_.constraints;
        const bool constrained = node.linked && matching_.constraints;
        value.e.resize(records + (linked ? n : 0));
        if (derivatives) {
            value.e_theta = MatrixXd::Zero(value.e.size(), data.binding.estimated_count);
            value.e_z.resize(value.e.size(), n);
        }
        Index loaded = -2;
        /// Derivatives of the state at an instant (-1: the node) with respect to the node and the parameters.
        const auto load = [&](Index instant) {
            if (loaded == instant) return;
            loaded = instant;
            if (instant < 0) {
                sensitivity.setZero();
                sensitivity.leftCols(n).setIdentity();
                return;
            }
            sensitivity = flows[at].sensitivity(place[static_cast<std::size_t>(instant)], d);
            if (!moves) return;
            const auto rate = rates.col(k * (m + 1) + 1 + instant);
            VectorXd moved = VectorXd::Zero(n);
            if (data.plan.clock == models::Clock::phase) {
                if (pattern.instants[static_cast<std::size_t>(instant)].delayed)
                    moved = data.options.sensor.delay / omega * rate;
            } else if (data.series.sampling == Series::Sampling::samples) {
                // Beginning later by dt in the same state leads to x(t) + [f(x(t)) - X f(x0)] dt.
                const double shift = data.series.segments[node.segment].times[node.sample] / omega;
                moved = shift * (rate - sensitivity.leftCols(n) * rates.col(k * (m + 1)));
            }
            sensitivity.rightCols(f) += moved * data.omega_slopes.transpose();
        };
        for (Index r = 0; r < records; ++r) {
            const PlannedReading& reading = readings[static_cast<std::size_t>(r)];
            const Index column = k * (m + 1) + 1 + reading.instant;
            value.e[r] = reading.value - read.readings(reading.coordinate, column);
            if (models::reads_angle(data.instant_sensor, system.coordinates(),
                                    static_cast<std::size_t>(reading.coordinate)))
                value.e[r] = models::wrapped(value.e[r]);
            if (!derivatives) continue;
            load(reading.instant);
            const auto by = read.derivatives.block(reading.coordinate, column * d, 1, d);
            total.noalias() = by.leftCols(n) * sensitivity;
            total.rightCols(f) += by.rightCols(f);
            value.e_z.row(r) = -total.leftCols(n);
            for (Index j = 0; j < f; ++j)
                value.e_theta(r, data.binding.estimated[static_cast<std::size_t>(j)]) -= total[n + j];
        }
        if (linked || constrained) {
            const auto end = states.col(k * (m + 1) + 1 + pattern.match);
            const VectorXd defect = wrapped_difference(system, latents[b + 1], end);
            if (constrained)
                value.c = defect;
            else
                value.e.tail(n) = defect;
            if (derivatives) {
                load(pattern.match);
                MatrixXd by_theta = MatrixXd::Zero(n, data.binding.estimated_count);
                for (Index j = 0; j < f; ++j)
                    by_theta.col(data.binding.estimated[static_cast<std::size_t>(j)]) -= sensitivity.col(n + j);
                if (constrained) {
                    value.c_theta = std::move(by_theta);
                    value.c_z = -sensitivity.leftCols(n);
                    value.c_next.setIdentity(n, n);
                } else {
                    value.e_theta.bottomRows(n) = by_theta;
                    value.e_z.bottomRows(n) = -sensitivity.leftCols(n);
                    value.e_next = MatrixXd::Zero(value.e.size(), n);
                    value.e_next.bottomRows(n).setIdentity();
                }
            }
        }
        if (!value.e.allFinite() || !value.c.allFinite() || !value.e_theta.allFinite() || !value.e_z.allFinite())
            value.status = BlockStatus::failed;
    }
}

}  // namespace orbid::orbits
