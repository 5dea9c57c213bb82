#include "orbits/invariants/correlation_dimension.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>

#include "estimator/interface/not_finite.hpp"
#include "orbits/invariants/correlation_sum.hpp"
#include "orbits/invariants/sample_stride.hpp"
#include "orbits/records/refusal.hpp"
#include "orbits/sections/section_points.hpp"

namespace orbid::orbits {
namespace {

constexpr std::size_t fewest_points = 1000;

constexpr int octaves = 30;             // down to 1e-10 of the range
constexpr double fewest_pairs = 400.0;  // of an octave's smallest radius, for a slope good to 10 %
constexpr double first_points = 2000.0;

// The scaling range: slopes in a row, half an octave each.
constexpr std::size_t shortest_range = 4;
constexpr double largest_scaling_radius = 0.1;  // beyond it the attractor's outline bends ln C
constexpr double scatter_allowed = 0.04;        // Cantor sets' slopes oscillate; Henon's by 3 %
constexpr double useful_slope_sd = 0.2;
constexpr double space_filling = 0.93;  // slopes above this share of the number of coordinates may be noise

// Steps from which the decay of staying pairs counts: the first ones turn separations into the unstable direction.
constexpr std::size_t settled = 3;
constexpr double fewest_staying = 200.0;

struct WithError {
    double value = estimator::nan_value, sd = estimator::nan_value;
};

// A function of the counts with its jackknife error over the stretches.
WithError jackknife(const OctaveCount& count, const std::function<double(const OctaveCount::Pairs&)>& function) {
    WithError result{function(count.all), 0.0};
    std::vector<double> values;
    double mean = 0.0;
    for (std::size_t s = 0; s < OctaveCount::stretches; ++s) {
        values.push_back(function(count.without(s)));
        mean += values.back() / static_cast<double>(OctaveCount::stretches);
    }
    double square = 0.0;
    for (const double value : values)
        square += (value - mean) * (value - mean);
    constexpr double blocks = OctaveCount::stretches;
    result.sd = std::sqrt((blocks - 1.0) / blocks * square);
    return result;
}

// -slope of ln(pairs that stay k steps) between `settled` and the last k with enough of them.
double decay(const OctaveCount::Pairs& pairs) {
    std::size_t last = settled;
    while (last + 1 < pairs.stay.size() && pairs.stay[last + 1] > fewest_staying)
        ++last;
    if (last < settled + 2) return estimator::nan_value;
    return std::log(pairs.stay[settled] / pairs.stay[last]) / static_cast<double>(last - settled);
}

struct Octave {
    double radius = 0.0;
    WithError takens, entropy;
};

struct Range {
    std::size_t first = 0, length = 0;
    double scatter = 0.0;
};

// Mean slope over a range, its sd, and how far the slopes scatter or drift beyond what is allowed.
struct Fit {
    double mean = 0.0, sd = 0.0;
    double scatter = 0.0;  // chi2 per degree of freedom, oscillations allowed for
    bool drifts = false;   // the two halves differ by more than the oscillations and their errors
};

Fit fit_range(const std::vector<CorrelationScale>& scales, const Range& range) {
    const auto mean_of = [&](std::size_t first, std::size_t length, double& variance, double typical) {
        double weight = 0.0, sum = 0.0;
        for (std::size_t s = first; s < first + length; ++s) {
            // The oscillation is an error of every slope: large radii with their small statistical errors must not
            // outweigh the others.
            const double allowed = scatter_allowed * typical;
            const double w = 1.0 / (scales[s].slope_sd * scales[s].slope_sd + allowed * allowed);
            weight += w;
            sum += w * scales[s].slope;
        }
        variance = 1.0 / weight;
        return sum / weight;
    };
    const double typical = scales[range.first + range.length / 2].slope;
    Fit fit;
    double variance = 0.0;
    fit.mean = mean_of(range.first, range.length, variance, typical);
    double square = 0.0, plain = 0.0;
    for (std::size_t s = range.first; s < range.first + range.length; ++s) {
        const double deviation = scales[s].slope - fit.mean, allowed = scatter_allowed * typical;
        square += deviation * deviation / (scales[s].slope_sd * scales[s].slope_sd + allowed * allowed);
        plain += deviation * deviation;
    }
    const double freedom = static_cast<double>(range.length - 1);
    fit.scatter = square / freedom;
    // Neighbouring slopes oscillate together: half as many count. The allowed scatter is in `variance` already.
    fit.sd = std::sqrt(std::max(variance, plain / freedom / (0.5 * static_cast<double>(range.length))));
    double upper = 0.0, lower = 0.0;
    const std::size_t half = range.length / 2;
    const double difference =
        mean_of(range.first, half, upper, typical) - mean_of(range.first + range.length - half, half, lower, typical);
    fit.drifts = !(std::abs(difference) <= 2.0 * std::sqrt(upper + lower));
    return fit;
}

void validate_correlation(const CorrelationOptions& options) {
    refuse_if(!(options.pairs >= 10'000 && options.pairs <= 1'000'000'000),
              "correlation_dimension: pairs must be in [10^4, 10^9], got {}", options.pairs);
    refuse_if(!(options.points >= fewest_points), "correlation_dimension: points must be at least {}, got {}",
              fewest_points, options.points);
}

std::vector<std::uint32_t> spread(const std::vector<std::uint32_t>& all, double wanted) {
    const auto count = std::min(all.size(), static_cast<std::size_t>(wanted));
    std::vector<std::uint32_t> chosen;
    for (std::size_t c = 0; c < count; ++c)
        chosen.push_back(all[c * all.size() / count]);
    return chosen;
}

// The longest range of constant slopes below a limit.
Range longest_range(const std::vector<CorrelationScale>& scales, double limit) {
    Range best;
    for (std::size_t first = 0; first < scales.size(); ++first) {
        if (!(scales[first].radius <= largest_scaling_radius)) continue;
        for (std::size_t length = shortest_range; first + length <= scales.size(); ++length) {
            if (!(scales[first + length - 1].slope_sd < useful_slope_sd)) break;
            const Fit fit = fit_range(scales, {first, length, 0.0});
            if (!(fit.scatter <= 1.0) || fit.drifts || !(fit.mean < limit)) continue;
            if (length > best.length || (length == best.length && fit.scatter < best.scatter))
                best = {first, length, fit.scatter};
        }
    }
    return best;
}

void find_scaling_range(const std::vector<Octave>& by_octave, double dimension, CorrelationDimension& result) {
    Range best = longest_range(result.scales, std::numeric_limits<double>::infinity());
    if (best.length > 0 && fit_range(result.scales, best).mean > space_filling * dimension) {
        const Range coarse = longest_range(result.scales, space_filling * dimension);
        if (coarse.length > 0 && coarse.first < best.first) {
            best = coarse;
            result.remarks.push_back("slopes rise to the number of coordinates at small radii: reading errors");
        }
    }
    if (best.length == 0) {
        result.remarks.push_back("no scaling range: the slopes of the correlation sum agree over no two octaves");
        return;
    }
    const Fit fit = fit_range(result.scales, best);
    result.dimension = fit.mean;
    result.sd = fit.sd;
    result.largest_radius = result.scales[best.first].radius;
    result.smallest_radius = result.scales[best.first + best.length - 1].radius / std::sqrt(2.0);
    double weight = 0.0, sum = 0.0, square = 0.0;
    std::vector<double> entropies;
    for (const Octave& octave : by_octave) {
        if (!(octave.radius <= result.largest_radius * 1.0001) || octave.radius < result.smallest_radius) continue;
        if (std::isnan(result.takens)) {
            result.takens = octave.takens.value;
            result.takens_sd = octave.takens.sd;
        }
        if (!std::isfinite(octave.entropy.value) || !std::isfinite(octave.entropy.sd)) continue;
        const double w = 1.0 / (octave.entropy.sd * octave.entropy.sd + 1e-8);  // rotations: all pairs stay, sd 0
        weight += w;
        sum += w * octave.entropy.value;
        entropies.push_back(octave.entropy.value);
    }
    if (!(weight > 0.0)) return;
    result.entropy = sum / weight;
    for (const double value : entropies)
        square += (value - result.entropy) * (value - result.entropy);
    const auto count = static_cast<double>(entropies.size());
    result.entropy_sd = std::sqrt(1.0 / weight + (count > 1.0 ? square / (count - 1.0) / count : 0.0));
}

/// Finite points, and how many steps of `stride` points each of all points can be followed.
struct FollowedPoints {
    std::vector<std::uint32_t> all;
    std::vector<std::uint8_t> ahead;
    double time = 0.0;  ///< sum of the return times
};

FollowedPoints followed_points(const SectionPoints& points, std::size_t stride) {
    FollowedPoints result;
    auto& [all, ahead, time] = result;
    ahead.assign(points.size(), 0);
    for (std::size_t i = points.size(); i-- > 0;) {
        bool finite = true;
        for (Eigen::Index d = 0; d < points.dimension(); ++d)
            finite = finite && std::isfinite(points.point(i)[d]);
        if (finite) all.push_back(static_cast<std::uint32_t>(i));
        if (!points.has_image(i)) continue;
        if (points.timed()) time += points.return_time(i);
        // Steps of `stride` points: every one between has an image as well.
        const std::size_t next = i + stride;
        if (next < points.size()) ahead[i] = static_cast<std::uint8_t>(std::min(255, ahead[next] + 1));
    }
    std::reverse(all.begin(), all.end());
    // Points that cannot be followed to the end of the run they are in must not count the next run's steps.
    std::size_t run = 0;
    for (std::size_t i = points.size(); i-- > 0;) {
        run = points.has_image(i) ? run + 1 : 0;
        ahead[i] = static_cast<std::uint8_t>(std::min<std::size_t>(ahead[i], run / stride));
    }
    return result;
}

Octave measured_octave(const OctaveCount& count, double radius, std::size_t chosen,
                       std::vector<CorrelationScale>& scales) {
    Octave octave{radius, {}, {}};
    octave.takens = jackknife(count, [](const auto& s) { return s.different / s.ln_ratio; });
    octave.entropy = jackknife(count, decay);
    for (std::size_t k = 0; k < 2; ++k) {
        const WithError slope = jackknife(
            count, [&](const auto& s) { return std::log(s.within[k] / s.within[k + 1]) / std::log(std::sqrt(2.0)); });
        scales.push_back({radius / std::pow(2.0, 0.5 * static_cast<double>(k)), chosen,
                          static_cast<std::size_t>(count.all.within[k]), count.all.within[k] / count.candidates,
                          slope.value, slope.sd, k == 0 ? octave.entropy.value : estimator::nan_value});
    }
    return octave;
}

}  // namespace

CorrelationDimension correlation_dimension(const Series& series, const CorrelationOptions& options) {
    validate_correlation(options);
    CorrelationDimension result;
    result.dimension = result.sd = result.takens = result.takens_sd = result.entropy = result.entropy_sd =
        estimator::nan_value;
    const bool samples = series.sampling == Series::Sampling::samples;
    const std::size_t stride = samples ? sample_stride(series) : 1;
    const SectionPoints points(samples ? strided(series, 1) : series, std::nullopt, {}, options.interrupted);
    result.timed = points.timed();
    result.theiler = options.theiler > 0 ? options.theiler : 10 * stride;

    auto [all, ahead, time] = followed_points(points, stride);
    all = spread(all, static_cast<double>(options.points));
    refuse_record_if(all.size() < fewest_points,
                     "correlation_dimension: {} points without missing coordinates, at least {} are needed", all.size(),
                     fewest_points);
    const double step_time = result.timed && points.image_count() > 0
                                 ? time / static_cast<double>(points.image_count()) * static_cast<double>(stride)
                                 : 1.0;

    std::vector<Octave> by_octave;
    double wanted = first_points;
    double identical = 0.0;
    for (int o = 0; o < octaves; ++o) {
        const double radius = 0.4 * std::pow(0.5, o);
        std::vector<std::uint32_t> chosen = spread(all, wanted);
        OctaveCount count = count_pairs(points, chosen, radius, result.theiler, ahead, stride);
        OctaveCount::Pairs sum = count.all;
        // The share of near pairs is only known afterwards: once more with more points where too few were found.
        const auto aim = static_cast<double>(options.pairs);
        if (sum.within[0] < 0.5 * aim && chosen.size() < all.size()) {
            wanted = static_cast<double>(chosen.size()) * std::sqrt(aim / std::max(sum.within[0], aim / 64.0));
            chosen = spread(all, wanted);
            count = count_pairs(points, chosen, radius, result.theiler, ahead, stride);
            sum = count.all;
        }
        if (!(sum.within[2] > fewest_pairs)) break;
        identical = 1.0 - sum.different / sum.within[0];
        if (identical > 0.1) break;
        by_octave.push_back(measured_octave(count, radius, chosen.size(), result.scales));
    }
    if (identical > 0.1)
        result.remarks.push_back(
            "smaller radii are left out: more than a tenth of the near pairs coincide exactly "
            "(rounded readings)");
    find_scaling_range(by_octave, static_cast<double>(points.dimension()), result);
    result.entropy /= step_time;
    result.entropy_sd /= step_time;
    return result;
}

}  // namespace orbid::orbits
