#include "periodic/waveforms/waveform_scan.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "models/definition/parameter.hpp"
#include "periodic/orbit/full_turn.hpp"
#include "periodic/orbit/winding_number.hpp"

namespace orbid::periodic {
namespace {

constexpr Index places_per_period = 256;
/// Samples of a record that are compared, evenly over it.
constexpr Index most_samples = 400;

}  // namespace

WaveformScan::WaveformScan(const WaveformCase& of) : of_(of) {
    const WaveformRecord& record = of.record;
    const Index stride = std::max<Index>(1, record.times.size() / most_samples);
    for (Index k = 0; k < record.times.size(); k += stride)
        samples_.push_back(k);
    variance_ = VectorXd::Ones(record.values.rows());
    mean_ = VectorXd::Zero(record.values.rows());
    for (Index c = 0; c < record.values.rows(); ++c) {
        double sum = 0.0, square = 0.0, number = 0.0;
        for (Index k = 0; k < record.times.size(); ++k) {
            const double y = record.values(c, k);
            if (!std::isfinite(y)) continue;
            sum += y;
            square += y * y;
            number += 1.0;
        }
        if (number == 0.0) continue;
        mean_(c) = sum / number;
        const double variance = square / number - mean_(c) * mean_(c);
        if (variance > 0.0) variance_(c) = variance;
    }
}

bool WaveformScan::reads_angle(std::size_t channel) const {
    return models::reads_angle(of_.record.sensor, of_.system.coordinates(),
                               static_cast<std::size_t>(of_.channels[channel].coordinate));
}

std::optional<WaveformPlace> WaveformScan::place(const PeriodicOrbit& orbit, const PhaseOrigin& origin) const {
    const Index grid = places_per_period * orbit.period;
    const double turn = full_turn * orbit.period;
    std::vector<double> times(static_cast<std::size_t>(grid)), places(times);
    for (std::size_t g = 0; g < times.size(); ++g) {
        times[g] = orbit.time * static_cast<double>(g) / static_cast<double>(grid);
        places[g] = of_.forced() ? turn * static_cast<double>(g) / static_cast<double>(grid) : times[g];
    }
    const CurveReadings curve =
        readings_along(of_.system, of_.theta, orbit, origin, of_.record.sensor, times, 0.0, std::nullopt, of_.flow);
    const CurveStates states = SolvedCurve(of_.system, of_.theta, orbit, of_.flow).states(places);
    if (!curve.simulated || !states.simulated) return std::nullopt;

    WaveformPlace best;
    best.size = states.states.cwiseAbs().rowwise().maxCoeff();
    for (double& size : best.size)
        if (!(size > 0.0)) size = 1.0;
    for (const Index i : angle_coordinates(of_.system))
        best.size(i) = full_turn;
    best.misfit = std::numeric_limits<double>::infinity();
    if (of_.record.phase.estimate) {
        for (Index g = 0; g < grid; ++g)
            try_phase(curve.readings, orbit.time, turn, turn * static_cast<double>(g) / static_cast<double>(grid),
                      best);
    } else {
        try_phase(curve.readings, orbit.time, turn, of_.record.phase.value, best);
    }
    if (!std::isfinite(best.misfit)) return std::nullopt;
    return best;
}

std::vector<double> WaveformScan::errors(std::size_t channel, const MatrixXd& table, double time, double share) const {
    const Index grid = table.cols();
    const Index coordinate = of_.channels[channel].coordinate;
    const bool angle = reads_angle(channel);
    std::vector<double> errors;
    for (const Index k : samples_) {
        const double y = of_.record.values(static_cast<Index>(channel), k);
        if (!std::isfinite(y)) continue;
        double place = share + of_.record.times(k) / time;
        place = (place - std::floor(place)) * static_cast<double>(grid);
        const Index below = std::min(static_cast<Index>(place), grid - 1);
        double rise = table(coordinate, (below + 1) % grid) - table(coordinate, below);
        if (angle) rise = models::wrapped(rise);
        const double e = y - table(coordinate, below) - rise * (place - static_cast<double>(below));
        errors.push_back(angle ? models::wrapped(e) : e);
    }
    return errors;
}

void WaveformScan::try_phase(const MatrixXd& table, double time, double turn, double phase, WaveformPlace& best) const {
    VectorXd offsets = VectorXd::Zero(of_.record.values.rows());
    double misfit = 0.0;
    double number = 0.0;
    for (std::size_t c = 0; c < of_.channels.size(); ++c) {
        const std::vector<double> all = errors(c, table, time, phase / turn);
        if (all.empty()) continue;
        double& offset = offsets(static_cast<Index>(c));
        if (!of_.record.offsets.empty()) offset = of_.record.offsets[c].value;
        if (!of_.record.offsets.empty() && of_.record.offsets[c].estimate) {
            double sum = 0.0, cosines = 0.0, sines = 0.0;
            for (const double e : all) {
                sum += e;
                cosines += std::cos(e);
                sines += std::sin(e);
            }
            offset = reads_angle(c) ? std::atan2(sines, cosines) : sum / static_cast<double>(all.size());
        }
        for (const double e : all) {
            const double left = reads_angle(c) ? models::wrapped(e - offset) : e - offset;
            misfit += left * left / variance_(static_cast<Index>(c));
        }
        number += static_cast<double>(all.size());
    }
    misfit /= std::max(number, 1.0);
    if (!(misfit < best.misfit)) return;
    best.misfit = misfit;
    best.phase = phase;
    best.offsets = std::move(offsets);
}

}  // namespace orbid::periodic
