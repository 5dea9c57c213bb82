#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <stdexcept>

#include "models/definition/parameter.hpp"
#include "models/system/stopped.hpp"
#include "orbits/records/refusal.hpp"
#include "orbits/sections/sampled_section.hpp"
#include "periodic/orbit/full_turn.hpp"

namespace orbid::orbits {
namespace {

// An instant this near to a sample (in sampling intervals) is that sample's.
constexpr double on_sample = 1e-6;

struct Instant {
    Eigen::Index sample;
    double u;
};

/// Per segment where a phase returns.
struct StrobeInstants {
    std::vector<std::vector<Instant>> instants;
    std::vector<std::vector<Eigen::Index>> marks;  ///< samples at or before them
    bool all_on_samples = true, any = false;
};

StrobeInstants strobe_instants(const Series& samples, double period, double offset, double step) {
    StrobeInstants result;
    auto& [instants, marks, all_on_samples, any] = result;
    instants.resize(samples.segments.size());
    marks.resize(samples.segments.size());
    for (std::size_t s = 0; s < instants.size(); ++s) {
        const Eigen::VectorXd& times = samples.segments[s].times;
        if (times.size() < 2) continue;
        for (double k = std::ceil((times[0] - offset) / period - on_sample);; k += 1.0) {
            const double place = (offset + k * period - times[0]) / step;
            if (place > static_cast<double>(times.size() - 1) + on_sample) break;
            if (place < -on_sample) continue;
            const double nearest = std::nearbyint(place);
            const bool here = std::abs(place - nearest) <= on_sample;
            const auto sample = static_cast<Eigen::Index>(here ? nearest : std::floor(place));
            instants[s].push_back({sample, here ? 0.0 : place - std::floor(place)});
            marks[s].push_back(sample);
            all_on_samples = all_on_samples && here;
            any = true;
        }
    }
    return result;
}

/// The segment at these instants: its samples where no windows were chosen, smoothed otherwise. Variances of readings
/// are added to the section's covariance, and counted.
Segment piece_at(const Segment& segment, const std::vector<Instant>& instants, double step, SampledSection& section,
                 Eigen::VectorXd& counts) {
    const Eigen::Index n = counts.size();
    const bool all_on_samples = section.windows.empty();
    const auto m = static_cast<Eigen::Index>(instants.size());
    Segment piece{segment.label, Eigen::MatrixXd::Constant(n, m, std::numeric_limits<double>::quiet_NaN()), {}, {}};
    piece.deviations = piece.values;
    for (Eigen::Index d = 0; d < n; ++d) {
        const bool angle = section.series.coordinate(d).angle;
        const double sd = section.sample_deviation[d];
        std::optional<TimeSmoothing> smoothing;
        if (!all_on_samples) smoothing.emplace(segment, d, angle, step, section.windows[static_cast<std::size_t>(d)]);
        for (Eigen::Index k = 0; k < m; ++k) {
            const Instant& instant = instants[static_cast<std::size_t>(k)];
            double variance = 1.0;
            if (all_on_samples) {
                piece.values(d, k) = segment.values(d, instant.sample);
            } else {
                const SmoothedValue smoothed = smoothing->at(instant.sample, instant.u);
                if (!smoothed.reliable()) continue;
                piece.values(d, k) = angle ? models::wrapped(smoothed.value) : smoothed.value;
                variance = smoothed.value_variance;
            }
            if (!std::isfinite(piece.values(d, k))) continue;
            section.reading_covariance(d, d) += sd * sd * variance;
            counts[d] += 1.0;
            if (sd > 0.0) piece.deviations(d, k) = sd * std::sqrt(variance);
        }
    }
    return piece;
}

}  // namespace

SampledSection stroboscopic_section(const Series& samples, double period, double phase,
                                    const std::function<bool()>& interrupted) {
    check_samples(samples, "stroboscopic_section");
    const double step = sampling_interval(samples, "stroboscopic_section");
    refuse_record_if(!(period >= 2.0 * step) || !std::isfinite(period),
                     "stroboscopic_section: the period must be at least two sampling intervals of {} s, got {} s", step,
                     period);
    if (!std::isfinite(phase)) throw std::invalid_argument("stroboscopic_section: the phase must be finite");
    const double offset = period * (phase - samples.phase) / periodic::full_turn;

    const auto [instants, marks, all_on_samples, any] = strobe_instants(samples, period, offset, step);
    refuse_record_if(!any, "stroboscopic_section: no segment reaches the phase {} rad within its samples (period {} s)",
                     phase, period);

    SampledSection section;
    section.series.coordinates = samples.coordinates;
    section.series.phase = phase;
    section.series.origin = samples.origin;
    const Eigen::Index n = samples.dimension();
    section.sample_deviation.resize(n);
    section.reading_covariance = Eigen::MatrixXd::Zero(n, n);
    const auto places = places_near(marks);
    for (Eigen::Index d = 0; d < n; ++d) {
        models::stop_if_asked(interrupted);
        section.sample_deviation[d] = std::sqrt(difference_variance(samples, d));
        if (!all_on_samples) section.windows.push_back(best_window(samples, d, places, interrupted));
    }
    Eigen::VectorXd counts = Eigen::VectorXd::Zero(n);
    for (std::size_t s = 0; s < instants.size(); ++s) {
        if (instants[s].empty()) continue;
        models::stop_if_asked(interrupted);
        section.series.segments.push_back(piece_at(samples.segments[s], instants[s], step, section, counts));
    }
    for (Eigen::Index d = 0; d < n; ++d)
        section.reading_covariance(d, d) /= std::max(counts[d], 1.0);
    return section;
}

}  // namespace orbid::orbits
