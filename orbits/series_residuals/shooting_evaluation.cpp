#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <cassert>
#include <numeric>

#include "orbits/series_residuals/shooting_residual.hpp"
#include "orbits/simulation/node_state.hpp"
#include "orbits/simulation/section_map.hpp"
#include "orbits/simulation/transition.hpp"

namespace orbid::orbits {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using estimator::BlockStatus;
using estimator::BlockValue;

namespace {

/// Durations in ascending order, for delayed ones may overtake others. @param place  of each among them.
std::vector<double> ascending(const std::vector<double>& durations, std::vector<Index>& place) {
    std::vector<std::size_t> order(durations.size());
    std::iota(order.begin(), order.end(), std::size_t{0});
    std::stable_sort(order.begin(), order.end(),
                     [&](std::size_t a, std::size_t b) { return durations[a] < durations[b]; });
    std::vector<double> result;
    place.resize(durations.size());
    for (std::size_t j = 0; j < order.size(); ++j) {
        result.push_back(durations[order[j]]);
        place[order[j]] = static_cast<Index>(j);
    }
    return result;
}

/// Sets how far the end of an interval is from the next node: the last residuals of a block, or its constraints.
/// @param state  derivatives of that end; empty: none are wanted.
void set_match(const VectorXd& defect, bool linked, const MatrixXd& state, const std::vector<Index>& estimated,
               BlockValue& value) {
    const Index n = defect.size();
    if (linked)
        value.e.tail(n) = defect;
    else
        value.c = defect;
    if (state.size() == 0) return;
    MatrixXd by_theta = MatrixXd::Zero(n, value.e_theta.cols());
    for (std::size_t j = 0; j < estimated.size(); ++j)
        by_theta.col(estimated[j]) -= state.col(n + static_cast<Index>(j));
    if (linked) {
        value.e_theta.bottomRows(n) = by_theta;
        value.e_z.bottomRows(n) = -state.leftCols(n);
        value.e_next = MatrixXd::Zero(value.e.size(), n);
        value.e_next.bottomRows(n).setIdentity();
    } else {
        value.c_theta = std::move(by_theta);
        value.c_z = -state.leftCols(n);
        value.c_next.setIdentity(n, n);
    }
}

}  // namespace

/// Nodes that are simulated together, all or some of one pattern.
struct ShootingResidual::Chunk {
    const InstantPattern* pattern;
    std::span<const std::size_t> nodes;
    models::FlowOptions flow;
};

/// Flows of a chunk, and what the instrument reads on them. Column k (m + 1) + 1 + j belongs to instant j of node k,
/// j = -1 to the node itself; m instants in all.
struct ShootingResidual::Simulated {
    const InstantPattern* pattern = nullptr;
    Index instants = 0;        ///< m
    Index directions = 0;      ///< d: n + parameters, 0 without derivatives
    double omega = 1.0;        ///< [rad/s] of the forcing
    std::vector<Index> place;  ///< of each instant among the ascending durations of the flows
    std::vector<models::FlowResult> flows;
    std::vector<char> ok;  ///< per node
    MatrixXd states;
    models::ReadingResult read;
    MatrixXd rates;  ///< x' at all columns, where an estimated frequency needs it; else empty

    [[nodiscard]] Index column(Index node, Index instant) const { return node * (instants + 1) + 1 + instant; }
};

std::vector<BlockValue> ShootingResidual::evaluate(const estimator::ActiveSet& active, const VectorXd& theta,
                                                   const std::vector<VectorXd>& latents, bool derivatives) const {
    assert(latents.size() == active.layout.size());
    std::vector<BlockValue> values(active.layout.size());
    const Data& data = *data_;
    const VectorXd all = data.binding.values(theta);
    const bool possible = in_domain(data.system(), all);
    // 1024 flows of some microseconds: enough for packs and threads, little memory in flight.
    constexpr std::size_t together = 1024;
    std::vector<Chunk> chunks;
    const models::FlowOptions flow = stage_flow(active);
    std::vector<std::vector<std::size_t>> evaluated(data.plan.patterns.size());
    for (std::size_t p = 0; p < evaluated.size(); ++p) {
        for (const std::size_t b : data.plan.patterns[p].nodes) {
            if (!active.layout[b].active) continue;
            if (possible && latents[b].allFinite())
                evaluated[p].push_back(b);
            else
                values[b].status = BlockStatus::failed;
        }
        const std::span<const std::size_t> nodes(evaluated[p]);
        for (std::size_t first = 0; first < nodes.size(); first += together)
            chunks.push_back(
                {&data.plan.patterns[p], nodes.subspan(first, std::min(together, nodes.size() - first)), flow});
    }
    oneapi::tbb::parallel_for(std::size_t{0}, chunks.size(),
                              [&](std::size_t c) { evaluate(chunks[c], all, latents, derivatives, values); });
    return values;
}

/// As accurate as the present matching needs, so that steps of the integrator do not show: with a hundredth of its sd a
/// series of 42 754 sections stopped 0.1 sds of the length short of its minimum.
models::FlowOptions ShootingResidual::stage_flow(const estimator::ActiveSet& active) const {
    constexpr double share = 0.003;
    constexpr double roughest = 1e-7;
    models::FlowOptions flow = data_->options.flow;
    // A diffusion leaves coordinates that integrate it less room.
    const double room = noise_ ? std::min(1.0, unit_.cwiseQuotient(data_->range).minCoeff()) : 1.0;
    const double enough =
        matching_.constraints ? 0.0 : std::min(roughest, share * room * active.memory.front()[tightness]);
    flow.relative_tolerance = std::max(flow.relative_tolerance, enough);
    flow.absolute_tolerance = std::max(flow.absolute_tolerance, enough);
    return flow;
}

ShootingResidual::Simulated ShootingResidual::simulated(const Chunk& chunk, const VectorXd& all,
                                                        const std::vector<VectorXd>& latents, bool derivatives) const {
    const Data& data = *data_;
    const InstantPattern& pattern = *chunk.pattern;
    const models::System& system = system_of(pattern.input);
    const Index n = system.dimension();
    const auto count = std::ssize(chunk.nodes);
    Simulated result;
    result.pattern = chunk.pattern;
    result.instants = std::ssize(pattern.instants);
    result.directions = derivatives ? n + std::ssize(data.binding.parameter) : 0;
    if (system.kind() == models::Kind::forced) result.omega = phase_rate(system, all);

    const double delay = data.options.sensor.delay * (data.plan.clock == models::Clock::phase ? result.omega : 1.0);
    std::vector<double> durations;
    for (const Instant& instant : pattern.instants)
        durations.push_back(instant.after + (instant.delayed ? delay : 0.0));
    const std::vector<double> in_order = ascending(durations, result.place);

    MatrixXd starts(n, count);
    std::vector<double> phases(chunk.nodes.size());
    for (std::size_t k = 0; k < chunk.nodes.size(); ++k) {
        const PlannedNode& node = data.plan.nodes[chunk.nodes[k]];
        starts.col(static_cast<Index>(k)) = latents[chunk.nodes[k]];
        phases[k] =
            phase_at(system, all, data.series, data.series.segments[node.segment], node.sample) - data.later(all);
    }
    const std::optional<std::span<const Index>> free =
        derivatives ? std::optional<std::span<const Index>>(data.binding.parameter) : std::nullopt;
    if (result.instants > 0)
        result.flows = system.flows(starts, phases, in_order, all, free, data.plan.clock, chunk.flow);

    // Some eight trajectories advance together, and wait for the slowest.
    std::uint64_t cost = 0, longest = 0;
    for (const models::FlowResult& one : result.flows) {
        cost += flow_cost(one);
        longest = std::max(longest, flow_cost(one));
    }
    cost = std::max(cost, longest * std::min<std::uint64_t>(8, result.flows.size()));
    data.work.fetch_add(flow_work(system, cost, result.directions), std::memory_order_relaxed);
    result.ok.assign(chunk.nodes.size(), 1);
    result.states.resize(n, count * (result.instants + 1));
    std::vector<double> instant_phases(static_cast<std::size_t>(result.states.cols()));
    const double rate = data.plan.clock == models::Clock::phase ? 1.0 : phase_rate(system, all);
    for (Index k = 0; k < count; ++k) {
        const auto at = static_cast<std::size_t>(k);
        if (result.instants > 0)
            result.ok[at] =
                result.flows[at].status == models::FlowStatus::ok && result.flows[at].states.allFinite() ? 1 : 0;
        for (Index j = -1; j < result.instants; ++j) {
            const auto instant = static_cast<std::size_t>(j);
            const Index column = result.column(k, j);
            instant_phases[static_cast<std::size_t>(column)] = phases[at] + (j < 0 ? 0.0 : rate * durations[instant]);
            if (j < 0 || result.ok[at] == 0)
                result.states.col(column) = starts.col(k);
            else
                result.states.col(column) = result.flows[at].states.col(result.place[instant]);
        }
    }
    result.read = system.readings(data.instant_sensor, result.states, instant_phases, all, free, data.options.flow);
    // What an estimated frequency or delay moves beside the flow: the phase of a node at a time, the instant of a
    // second reading.
    const bool moves = !data.omega_slopes.isZero(0.0) || !data.delay_slopes.isZero(0.0);
    if (derivatives && moves) result.rates = system.rhs(result.states, instant_phases, all);
    return result;
}

/// Derivatives of the state at an instant (-1: the node) with respect to the node and the parameters, shape (n, d).
void ShootingResidual::set_sensitivity(const Simulated& run, Index k, std::size_t node, Index instant,
                                       MatrixXd& result) const {
    const Data& data = *data_;
    const Index n = run.states.rows();
    const Index d = run.directions;
    if (instant < 0) {
        result.setIdentity(n, d);
        return;
    }
    result = run.flows[static_cast<std::size_t>(k)].sensitivity(run.place[static_cast<std::size_t>(instant)], d);
    if (run.rates.size() == 0) return;
    const auto rate = run.rates.col(run.column(k, instant));
    // Beginning later by dt in the same state leads to x(t) + [f(x(t)) - X f(x0)] dt.
    const VectorXd later = rate - result.leftCols(n) * run.rates.col(run.column(k, -1));
    if (!data.delay_slopes.isZero(0.0)) result.rightCols(d - n) -= later * data.delay_slopes.transpose();
    VectorXd moved = VectorXd::Zero(n);
    if (data.plan.clock == models::Clock::phase) {
        if (run.pattern->instants[static_cast<std::size_t>(instant)].delayed)
            moved = data.options.sensor.delay / run.omega * rate;
    } else if (data.series.sampling == Series::Sampling::samples) {
        const PlannedNode& at = data.plan.nodes[node];
        const double shift = data.series.segments[at.segment].times[at.sample] / run.omega;
        moved = shift * later;
    }
    result.rightCols(d - n) += moved * data.omega_slopes.transpose();
}

void ShootingResidual::evaluate(const Chunk& chunk, const VectorXd& all, const std::vector<VectorXd>& latents,
                                bool derivatives, std::vector<BlockValue>& values) const {
    const Simulated run = simulated(chunk, all, latents, derivatives);
    if (run.read.status != models::FlowStatus::ok && chunk.nodes.size() > 1) {
        // Which one it is, each for itself tells.
        for (std::size_t k = 0; k < chunk.nodes.size(); ++k)
            evaluate(Chunk{chunk.pattern, chunk.nodes.subspan(k, 1), chunk.flow}, all, latents, derivatives, values);
        return;
    }
    for (std::size_t k = 0; k < chunk.nodes.size(); ++k) {
        const std::size_t b = chunk.nodes[k];
        if (run.ok[k] == 0 || run.read.status != models::FlowStatus::ok)
            values[b].status = BlockStatus::failed;
        else
            values[b] = value(run, static_cast<Index>(k), b, latents, derivatives);
    }
}

BlockValue ShootingResidual::value(const Simulated& run, Index k, std::size_t b, const std::vector<VectorXd>& latents,
                                   bool derivatives) const {
    const Data& data = *data_;
    const models::System& system = system_of(run.pattern->input);
    const Index n = system.dimension();
    const Index d = run.directions;
    const auto& estimated = data.binding.estimated;
    const auto readings = data.plan.of(b);
    const auto records = std::ssize(readings);
    const bool matched = data.plan.nodes[b].linked;
    const bool linked = matched && !matching_.constraints;
    BlockValue value;
    value.e.resize(records + (linked ? n : 0));
    if (derivatives) {
        value.e_theta = MatrixXd::Zero(value.e.size(), data.binding.estimated_count);
        value.e_z.setZero(value.e.size(), n);
    }
    MatrixXd state;  // derivatives of the one at the present instant
    Index loaded = -2;
    const auto load = [&](Index instant) {
        if (loaded != instant) set_sensitivity(run, k, b, instant, state);
        loaded = instant;
    };
    for (Index r = 0; r < records; ++r) {
        const PlannedReading& reading = readings[static_cast<std::size_t>(r)];
        const Index column = run.column(k, reading.instant);
        value.e[r] = reading.value - run.read.readings(reading.coordinate, column);
        if (models::reads_angle(data.instant_sensor, system.coordinates(),
                                static_cast<std::size_t>(reading.coordinate)))
            value.e[r] = models::wrapped(value.e[r]);
        if (!derivatives) continue;
        load(reading.instant);
        // Plain loops: the matrices are as small as a state, and a call for general ones costs more than the sums.
        const auto by = run.read.derivatives.block(reading.coordinate, column * d, 1, d);
        for (Index j = 0; j < d; ++j) {
            double total = j < n ? 0.0 : by(0, j);
            for (Index i = 0; i < n; ++i)
                total += by(0, i) * state(i, j);
            (j < n ? value.e_z(r, j) : value.e_theta(r, estimated[static_cast<std::size_t>(j - n)])) -= total;
        }
    }
    if (matched) {
        const Index match = run.pattern->match;
        if (derivatives) load(match);
        set_match(wrapped_difference(system, latents[b + 1], run.states.col(run.column(k, match))), linked, state,
                  estimated, value);
        if (noise_) whiten(data.plan.nodes[b].pattern, value);
    }
    if (!value.e.allFinite() || !value.c.allFinite() || !value.e_theta.allFinite() || !value.e_z.allFinite())
        value.status = BlockStatus::failed;
    return value;
}

}  // namespace orbid::orbits
