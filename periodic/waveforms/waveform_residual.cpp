#include "periodic/waveforms/waveform_residual.hpp"

#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <cassert>
#include <cmath>
#include <span>
#include <utility>

#include "models/definition/parameter.hpp"
#include "periodic/solution/solve_orbit.hpp"
#include "periodic/waveforms/waveform_start.hpp"

namespace orbid::periodic {

using estimator::BlockStatus;
using estimator::BlockValue;

namespace {

/// A lost orbit is reactivated at most this often, so that updates of the active set end.
constexpr int most_returns = 2;
/// Minimisations that are repeated only because solutions had moved far from where they were known.
constexpr int most_anchorings = 3;
/// An orbit that is found at the end belongs to a record if it leaves less than this share of its variance: there the
/// model describes the others already.
constexpr double alike = 0.25;
/// Steps along the line to a theta that is too far for one: at most 2^4.
constexpr int most_halvings = 4;

BlockValue failed() {
    BlockValue value;
    value.status = BlockStatus::failed;
    return value;
}

/// The orbit with its derivatives by the estimator's vector.
PeriodicOrbit spread(PeriodicOrbit orbit, const models::ParameterBinding& binding) {
    orbit.sensitivities = binding.spread(orbit.sensitivities);
    if (orbit.time_sensitivities.size() > 0) orbit.time_sensitivities = binding.spread(orbit.time_sensitivities);
    return orbit;
}

}  // namespace

estimator::LatentStructure WaveformResidual::structure() const {
    for (const estimator::BlockLayout& block : layout())
        if (block.latents > 0) return estimator::LatentStructure::independent_blocks;
    return estimator::LatentStructure::none;
}

bool WaveformResidual::in_domain(const VectorXd& values) const {
    for (Index i = 0; i < values.size(); ++i)
        if (!models::contains(system_->parameters()[static_cast<std::size_t>(i)].domain, values(i))) return false;
    return true;
}

WaveformResidual::FoundStart WaveformResidual::find_start(std::size_t b, const VectorXd& theta) const {
    FoundStart found;
    Known& known = found.known;
    const VectorXd values = records_[b].binding.values(theta);
    WaveformStart start = find_waveform_start({*system_, values, records_[b], options_.channels, options_.flow});
    known.status = start.status;
    known.offsets = VectorXd::Zero(std::ssize(options_.channels));
    found.misfit = std::numeric_limits<double>::infinity();
    if (start.status != OrbitStatus::converged) return found;
    known.origin = std::move(start.origin);
    known.scale = std::move(start.place.size);
    known.phase = start.place.phase;
    known.offsets = std::move(start.place.offsets);
    known.orbit = std::move(start.orbit);
    known.orbit.sensitivities.resize(0, 0);
    const PeriodicOrbit orbit = solve_near(b, known, theta, true);
    known.status = orbit.status;
    if (orbit.status == OrbitStatus::converged) keep(known, b, orbit, theta);
    found.misfit = start.place.misfit;
    return found;
}

void WaveformResidual::keep(Known& known, std::size_t block, const PeriodicOrbit& orbit, const VectorXd& theta) const {
    known.orbit = spread(orbit, records_[block].binding);
    known.theta = theta;
}

PeriodicOrbit WaveformResidual::solve_near(std::size_t block, const Known& from, const VectorXd& theta,
                                           bool derivatives) const {
    const models::ParameterBinding& binding = records_[block].binding;
    const VectorXd values = binding.values(theta);
    PeriodicOrbit none;
    none.status = OrbitStatus::not_simulated;
    if (!theta.allFinite() || !in_domain(values)) return none;
    StartingSolution start;
    start.points = from.orbit.points;
    start.rotation = from.orbit.rotation;
    const bool autonomous = system_->kind() == models::Kind::autonomous;
    if (autonomous) {
        start.points = from.orbit.points.leftCols(1);
        start.time = from.orbit.time;
    }
    if (from.theta.size() > 0) {
        const VectorXd step = theta - from.theta;
        const VectorXd move = from.orbit.sensitivities.topRows(start.points.size()) * step;
        start.points += move.reshaped(start.points.rows(), start.points.cols());
        // T by its logarithm, as Newton's method moves it: it stays positive.
        if (autonomous) start.time *= std::exp(from.orbit.time_sensitivities.dot(step) / from.orbit.time);
    }
    if (!start.points.allFinite() || !(start.time < std::numeric_limits<double>::infinity())) return none;
    ShootingOptions options;
    options.scale = from.scale;
    options.maximum_distance = options_.maximum_move;
    options.flow = options_.flow;
    const std::vector<Index> no_parameters;
    return solve_orbit(*system_, values, start, derivatives ? binding.parameter : no_parameters, options);
}

PeriodicOrbit WaveformResidual::solve(std::size_t block, const Known& known, const VectorXd& theta,
                                      bool derivatives) const {
    PeriodicOrbit orbit = solve_near(block, known, theta, derivatives);
    if (orbit.status == OrbitStatus::converged) return orbit;
    // A step that is too long for one prediction is divided into shorter ones.
    for (int halvings = 1; halvings <= most_halvings; ++halvings) {
        const int steps = 1 << halvings;
        Known from = known;
        bool reached = true;
        for (int i = 1; i < steps && reached; ++i) {
            const double share = static_cast<double>(i) / steps;
            const VectorXd between = known.theta + share * (theta - known.theta);
            PeriodicOrbit next = solve_near(block, from, between, true);
            reached = next.status == OrbitStatus::converged;
            if (!reached) break;
            from.theta = between;
            from.orbit = spread(std::move(next), records_[block].binding);
        }
        if (!reached) continue;
        PeriodicOrbit last = solve_near(block, from, theta, derivatives);
        if (last.status == OrbitStatus::converged) return last;
    }
    return orbit;
}

WaveformResidual::Alignment WaveformResidual::alignment(std::size_t block, const VectorXd& latents) const {
    const WaveformRecord& record = records_[block];
    const std::vector<Index>& unknowns = blocks_[block].unknowns;
    assert(latents.size() == std::ssize(unknowns));
    Alignment result{record.phase.value, VectorXd::Zero(std::ssize(options_.channels))};
    for (std::size_t c = 0; c < record.offsets.size(); ++c)
        result.offsets(static_cast<Index>(c)) = record.offsets[c].value;
    for (std::size_t i = 0; i < unknowns.size(); ++i) {
        const double value = latents(static_cast<Index>(i));
        (unknowns[i] < 0 ? result.phase : result.offsets(unknowns[i])) = value;
    }
    return result;
}

BlockValue WaveformResidual::value(std::size_t b, const Known& known, const VectorXd& theta, const VectorXd& latents,
                                   bool derivatives) const {
    if (!latents.allFinite()) return failed();
    const PeriodicOrbit orbit = solve(b, known, theta, derivatives);
    if (orbit.status != OrbitStatus::converged) return failed();
    const WaveformRecord& record = records_[b];
    const Block& block = blocks_[b];
    const VectorXd values = record.binding.values(theta);
    const std::span<const Index> free(record.binding.parameter);
    const Alignment place = alignment(b, latents);
    const std::span<const double> times(record.times.data(), static_cast<std::size_t>(record.times.size()));
    const CurveReadings read =
        readings_along(*system_, values, orbit, known.origin, record.sensor, times, place.phase,
                       derivatives ? std::optional<std::span<const Index>>(free) : std::nullopt, options_.flow);
    if (!read.simulated) return failed();

    const auto count = std::ssize(block.sources);
    const auto parameters = std::ssize(free);
    BlockValue result;
    result.e.resize(count);
    MatrixXd by_parameter(derivatives ? count : 0, parameters);
    if (derivatives) result.e_z = MatrixXd::Zero(count, latents.size());
    for (Index r = 0; r < count; ++r) {
        const Source& source = block.sources[static_cast<std::size_t>(r)];
        const Index channel = source.channel;
        const Index k = source.sample;
        const Index coordinate = options_.channels[static_cast<std::size_t>(channel)].coordinate;
        result.e(r) = record.values(channel, k) - read.readings(coordinate, k) - place.offsets(channel);
        if (models::reads_angle(record.sensor, system_->coordinates(), static_cast<std::size_t>(coordinate)))
            result.e(r) = models::wrapped(result.e(r));
        if (!derivatives) continue;
        by_parameter.row(r) = -read.by_parameters.row(coordinate).segment(k * parameters, parameters);
        for (std::size_t i = 0; i < block.unknowns.size(); ++i) {
            double& slope = result.e_z(r, static_cast<Index>(i));
            if (block.unknowns[i] < 0) slope = -read.by_phase(coordinate, k);
            if (block.unknowns[i] == channel) slope = -1.0;
        }
    }
    if (derivatives) result.e_theta = record.binding.spread(by_parameter);
    if (!result.e.allFinite() || !result.e_theta.allFinite() || !result.e_z.allFinite()) return failed();
    return result;
}

std::vector<BlockValue> WaveformResidual::evaluate(const estimator::ActiveSet& active, const VectorXd& theta,
                                                   const std::vector<VectorXd>& latents, bool derivatives) const {
    assert(latents.size() == blocks_.size());
    std::vector<BlockValue> values(blocks_.size());
    tbb::parallel_for(std::size_t{0}, blocks_.size(), [&](std::size_t b) {
        if (active.layout[b].active) values[b] = value(b, known(active, b), theta, latents[b], derivatives);
    });
    return values;
}

std::vector<PeriodicOrbit> WaveformResidual::solutions(const estimator::ActiveSet& active,
                                                       const VectorXd& theta) const {
    std::vector<PeriodicOrbit> orbits(blocks_.size());
    tbb::parallel_for(std::size_t{0}, blocks_.size(), [&](std::size_t b) {
        const Known from = known(active, b);
        orbits[b].status = from.status;
        if (from.theta.size() > 0) orbits[b] = solve(b, from, theta, false);
    });
    return orbits;
}

MatrixXd WaveformResidual::readings(const estimator::ActiveSet& active, std::size_t block, const VectorXd& theta,
                                    const PeriodicOrbit& orbit, const VectorXd& latents,
                                    std::span<const double> times) const {
    const WaveformRecord& record = records_[block];
    const VectorXd values = record.binding.values(theta);
    const Alignment place = alignment(block, latents);
    const CurveReadings read = readings_along(*system_, values, orbit, known(active, block).origin, record.sensor,
                                              times, place.phase, std::nullopt, options_.flow);
    if (!read.simulated) return {};
    MatrixXd result(std::ssize(options_.channels), read.readings.cols());
    for (std::size_t c = 0; c < options_.channels.size(); ++c) {
        const auto row = static_cast<Index>(c);
        result.row(row) = read.readings.row(options_.channels[c].coordinate).array() + place.offsets(row);
    }
    return result;
}

/// Seeks the orbits of lost records anew, from the records themselves, once per record. @return how many are back
int WaveformResidual::seek_lost(estimator::ActiveSet& active, const VectorXd& theta) const {
    std::vector<std::size_t> lost;
    for (std::size_t b = 0; b < blocks_.size(); ++b)
        if (!active.layout[b].active && !known(active, b).sought_again && in_domain(records_[b].binding.values(theta)))
            lost.push_back(b);
    tbb::parallel_for(std::size_t{0}, lost.size(), [&](std::size_t i) {
        const std::size_t b = lost[i];
        const Known before = known(active, b);
        auto [after, misfit] = find_start(b, theta);
        after.taken_back = before.taken_back;
        if (after.status != OrbitStatus::converged || !(misfit < alike)) after = before;
        after.sought_again = true;
        remember(active, b, after);
        active.layout[b].active = after.theta.size() > 0 && after.theta == theta;
    });
    return static_cast<int>(
        std::count_if(lost.begin(), lost.end(), [&](std::size_t b) { return active.layout[b].active; }));
}

estimator::RefreshReport WaveformResidual::update_active_set(estimator::ActiveSet& active, const VectorXd& theta,
                                                             const std::vector<VectorXd>& /*latents*/,
                                                             const VectorXd& /*scales*/) const {
    std::vector<PeriodicOrbit> solved(blocks_.size());
    tbb::parallel_for(std::size_t{0}, blocks_.size(), [&](std::size_t b) {
        const Known from = known(active, b);
        if (from.theta.size() > 0) solved[b] = solve(b, from, theta, true);
    });
    estimator::RefreshReport report;
    bool far = false;
    for (std::size_t b = 0; b < blocks_.size(); ++b) {
        Known last = known(active, b);
        if (last.theta.size() == 0) continue;
        const bool there = solved[b].status == OrbitStatus::converged;
        if (there) {
            const VectorXd move = (solved[b].points.col(0) - last.orbit.points.col(0)).cwiseQuotient(last.scale);
            far = far || !(move.cwiseAbs().maxCoeff() <= options_.maximum_move);
            keep(last, b, solved[b], theta);
        }
        estimator::BlockLayout& layout = active.layout[b];
        if (layout.active && !there) {
            layout.active = false;
            ++report.lost;
        } else if (!layout.active && there && last.taken_back < most_returns) {
            layout.active = true;
            ++last.taken_back;
            ++report.added;
        }
        remember(active, b, last);
    }
    // Solutions that were predicted from afar are predicted from here once more: near the end of a branch the
    // predictions alone may have stopped those steps.
    double& anchorings = active.memory.back()[0];
    const bool again = far && anchorings < most_anchorings;
    if (again) ++anchorings;
    report.changed = report.lost + report.added > 0 || again;
    if (!report.changed) {
        report.added = seek_lost(active, theta);
        report.changed = report.added > 0;
    }
    return report;
}

}  // namespace orbid::periodic
