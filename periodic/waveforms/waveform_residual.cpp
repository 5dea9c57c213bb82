#include "periodic/waveforms/waveform_residual.hpp"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <limits>
#include <span>
#include <utility>

#include "models/definition/parameter.hpp"
#include "periodic/waveforms/waveform_start.hpp"

namespace orbid::periodic {

using estimator::BlockValue;

estimator::LatentStructure WaveformResidual::structure() const {
    for (const estimator::BlockLayout& block : layout())
        if (block.latents > 0) return estimator::LatentStructure::independent_blocks;
    return estimator::LatentStructure::none;
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
    known.orbit = FollowedOrbit(std::move(start.orbit));
    known.orbit.sensitivities.resize(0, 0);
    const FollowedOrbit orbit = solve_near(b, known, theta, true);
    known.status = orbit.status;
    if (orbit.status == OrbitStatus::converged) keep(known, b, orbit, theta);
    found.misfit = start.place.misfit;
    return found;
}

VectorXd WaveformResidual::starting_latents(std::size_t block, const Known& known) const {
    VectorXd start(std::ssize(blocks_[block].unknowns));
    for (Index i = 0; i < start.size(); ++i) {
        const Index unknown = blocks_[block].unknowns[static_cast<std::size_t>(i)];
        start(i) = unknown < 0 ? known.phase : known.offsets(unknown);
    }
    return start;
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

BlockValue WaveformResidual::value(std::size_t b, const Known& known, const FollowedOrbit& orbit, const VectorXd& theta,
                                   const VectorXd& latents, bool derivatives) const {
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

}  // namespace orbid::periodic
