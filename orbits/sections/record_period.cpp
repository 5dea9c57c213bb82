#include "orbits/sections/record_period.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>

#include <fmt/format.h>

#include "orbits/records/refusal.hpp"
#include "orbits/sections/time_smoothing.hpp"
#include "periodic/orbit/full_turn.hpp"

namespace orbid::orbits {
namespace {

using Eigen::Index;

constexpr std::size_t most_instants = 4096;
constexpr Index longest_lag = 20000;
/// A record repeats if the rms distance is below this share of the sd of its readings, or this multiple of the noise.
constexpr double repeated_share = 0.2;
constexpr double noise_multiple = 2.0;
/// Minima of D up to this multiple of the deepest one count as equally deep.
constexpr double equally_deep = 1.5;
/// A minimum between lags is known to this share of the difference of two polynomials through it.
constexpr double accuracy_share = 0.2;
/// Reversals that count are larger than this share of the range, and than this multiple of the sd of a folded value.
constexpr double reversal_share = 0.01;
constexpr double reversal_noise = 6.0;
/// Pairs per lag below which a mean square says little.
constexpr double least_pairs = 8.0;

struct Row {
    Index coordinate;
    bool angle;
    double variance;
    double noise_variance;
};

double difference(double later, double earlier, bool angle) {
    const double d = later - earlier;
    return angle ? std::remainder(d, periodic::full_turn) : d;
}

/// Variance of the readings of a coordinate, of angles about their direction in the mean.
double variance_of(const Series& samples, std::span<const std::size_t> segments, Index coordinate, bool angle) {
    double sum = 0.0, square = 0.0, cosines = 0.0, sines = 0.0, number = 0.0;
    const auto each = [&](auto&& take) {
        for (const std::size_t s : segments)
            for (const double y : samples.segments[s].values.row(coordinate))
                if (std::isfinite(y)) take(y);
    };
    each([&](double y) {
        sum += y;
        cosines += std::cos(y);
        sines += std::sin(y);
        number += 1.0;
    });
    if (number < 2.0) return 0.0;
    const double centre = angle ? std::atan2(sines, cosines) : sum / number;
    each([&](double y) {
        const double d = difference(y, centre, angle);
        square += d * d;
    });
    return square / number;
}

/// D at the integer lags 0 to `most`; nan where too few pairs are there.
class LagDistance {
public:
    LagDistance(const Series& samples, std::span<const std::size_t> segments, const std::vector<Row>& rows)
        : samples_(samples), segments_(segments), rows_(rows) {}

    [[nodiscard]] double at(Index lag) const {
        double sum = 0.0, number = 0.0;
        for (const std::size_t s : segments_) {
            const Segment& segment = samples_.segments[s];
            const Index count = segment.values.cols() - lag;
            const Index stride = std::max<Index>(1, count / static_cast<Index>(most_instants));
            for (Index t = 0; t < count; t += stride) {
                for (const Row& row : rows_) {
                    const double d = difference(segment.values(row.coordinate, t + lag),
                                                segment.values(row.coordinate, t), row.angle);
                    if (!std::isfinite(d)) continue;
                    sum += d * d / (2.0 * row.variance);
                    number += 1.0;
                }
            }
        }
        return number < least_pairs ? std::numeric_limits<double>::quiet_NaN() : sum / number;
    }

private:
    const Series& samples_;
    std::span<const std::size_t> segments_;
    const std::vector<Row>& rows_;
};

/// A minimum of D between its lags.
struct Minimum {
    double lag = 0.0;
    double value = 0.0;
    double accuracy = 0.0;
};

/// The minimum of the polynomial of order 4 through five lags around `lag`; its accuracy is a share of what separates
/// it from the parabola through three.
Minimum minimum_near(const std::array<double, 5>& d, Index lag) {
    const double near_odd = d[3] - d[1], near_even = d[3] + d[1], far_odd = d[4] - d[0], far_even = d[4] + d[0];
    const double curvature = near_even - 2.0 * d[2];
    Minimum minimum{static_cast<double>(lag), d[2], 0.0};
    if (!(curvature > 0.0)) return minimum;
    double u = -0.5 * near_odd / curvature;
    const double parabola = d[2] - 0.125 * near_odd * near_odd / curvature;
    const double a1 = (8.0 * near_odd - far_odd) / 12.0, a2 = (16.0 * near_even - far_even - 30.0 * d[2]) / 24.0;
    const double a3 = (far_odd - 2.0 * near_odd) / 12.0, a4 = (far_even - 4.0 * near_even + 6.0 * d[2]) / 24.0;
    constexpr int steps = 10;
    for (int step = 0; step < steps; ++step) {
        const double slope = a1 + u * (2.0 * a2 + u * (3.0 * a3 + u * 4.0 * a4));
        const double bend = 2.0 * a2 + u * (6.0 * a3 + u * 12.0 * a4);
        if (!(bend > 0.0)) break;
        u = std::clamp(u - slope / bend, -1.0, 1.0);
    }
    const double value = d[2] + u * (a1 + u * (a2 + u * (a3 + u * a4)));
    minimum.lag += u;
    minimum.value = std::max(value, 0.0);
    minimum.accuracy = accuracy_share * std::abs(value - parabola);
    return minimum;
}

std::vector<Minimum> minima(const std::vector<double>& d) {
    std::vector<Minimum> found;
    // Beside lag 0 the record is near itself because it is smooth.
    std::size_t first = 0;
    const double largest = *std::max_element(d.begin(), d.end());
    while (first < d.size() && !(d[first] > 0.5 * largest))
        ++first;
    for (std::size_t lag = std::max<std::size_t>(first, 2); lag + 2 < d.size(); ++lag)
        if (d[lag] <= d[lag - 1] && d[lag] < d[lag + 1])
            found.push_back(
                minimum_near({d[lag - 2], d[lag - 1], d[lag], d[lag + 1], d[lag + 2]}, static_cast<Index>(lag)));
    return found;
}

/// A lag from its multiples, as far as the record has half of its pairs.
double refined_lag(const LagDistance& distance, double lag, Index longest) {
    for (int multiple = 2; multiple * lag < static_cast<double>(longest); multiple *= 2) {
        auto at = static_cast<Index>(std::lround(multiple * lag));
        std::array<double, 5> d{};
        const auto take = [&] {
            for (Index i = 0; i < 5; ++i)
                d[static_cast<std::size_t>(i)] = distance.at(at + i - 2);
        };
        take();
        // The guess is within a sample or two.
        for (int i = 0; i < 4 && (d[1] < d[2] || d[3] < d[2]); ++i) {
            at += d[1] < d[3] ? -1 : 1;
            take();
        }
        if (!(d[2] <= d[1] && d[2] <= d[3])) break;
        const double better = minimum_near(d, at).lag / multiple;
        if (!(std::abs(better - lag) * multiple < 2.0)) break;
        lag = better;
    }
    return lag;
}

/// The mean of one period of a coordinate, a value per sample of it; places that no sample falls into are left out.
std::vector<double> folded(const Segment& segment, Index coordinate, double lag) {
    const auto bins = static_cast<std::size_t>(std::max(8L, std::lround(lag)));
    std::vector<double> sums(bins, 0.0), numbers(bins, 0.0);
    const auto values = segment.values.row(coordinate);
    for (Index t = 0; t < values.size(); ++t) {
        if (!std::isfinite(values[t])) continue;
        const double turns = static_cast<double>(t) / lag;
        const auto bin =
            std::min(static_cast<std::size_t>((turns - std::floor(turns)) * static_cast<double>(bins)), bins - 1);
        sums[bin] += values[t];
        numbers[bin] += 1.0;
    }
    std::vector<double> mean;
    for (std::size_t bin = 0; bin < bins; ++bin)
        if (numbers[bin] > 0.0) mean.push_back(sums[bin] / numbers[bin]);
    return mean;
}

/// Maxima around a closed curve, between reversals by more than `least`.
int count_maxima(std::vector<double> curve, double least) {
    std::rotate(curve.begin(), std::min_element(curve.begin(), curve.end()), curve.end());
    curve.push_back(curve.front());
    int maxima = 0;
    double highest = curve.front(), lowest = curve.front();
    bool rising = false;
    for (const double y : curve) {
        highest = std::max(highest, y);
        lowest = std::min(lowest, y);
        if (rising && y < highest - least) {
            ++maxima;
            rising = false;
            lowest = y;
        } else if (!rising && y > lowest + least) {
            rising = true;
            highest = y;
        }
    }
    return maxima;
}

void add_maxima(const Series& samples, std::size_t longest, double lag, const std::vector<Row>& rows,
                RecordPeriod& result) {
    // Of the coordinate whose readings stand out most from their errors; an angle that runs on has no maxima.
    const Row* best = nullptr;
    for (const Row& row : rows)
        if (!row.angle &&
            (best == nullptr || row.noise_variance * best->variance < best->noise_variance * row.variance))
            best = &row;
    if (best == nullptr || result.periods < 1.0) return;
    result.of = best->coordinate;
    const std::vector<double> curve = folded(samples.segments[longest], best->coordinate, lag);
    const auto [lowest, highest] = std::minmax_element(curve.begin(), curve.end());
    const double least = std::max(reversal_share * (*highest - *lowest),
                                  reversal_noise * std::sqrt(best->noise_variance / result.periods));
    result.maxima = count_maxima(curve, least);
}

std::vector<Row> rows_of(const Series& samples, std::span<const Index> coordinates,
                         std::span<const std::size_t> segments) {
    std::vector<Row> rows;
    for (const Index c : coordinates) {
        refuse_if(c < 0 || c >= samples.dimension(), "record_period: the coordinate must be in [0, {}), got {}",
                  samples.dimension(), c);
        const bool angle = samples.coordinate(c).angle;
        const double variance = variance_of(samples, segments, c, angle);
        if (variance > 0.0) rows.push_back({c, angle, variance, difference_variance(samples, c)});
    }
    return rows;
}

}  // namespace

RecordPeriod record_period(const Series& samples, std::span<const Index> coordinates,
                           std::span<const std::size_t> segments) {
    check_samples(samples, "record_period");
    std::vector<std::size_t> all_segments(samples.segments.size());
    std::iota(all_segments.begin(), all_segments.end(), std::size_t{0});
    if (segments.empty()) segments = all_segments;
    std::vector<Index> all_coordinates(static_cast<std::size_t>(samples.dimension()));
    std::iota(all_coordinates.begin(), all_coordinates.end(), Index{0});
    if (coordinates.empty()) coordinates = all_coordinates;

    std::size_t longest = segments.front();
    for (const std::size_t s : segments) {
        refuse_if(s >= samples.segments.size(), "record_period: segment {}: there are {}", s, samples.segments.size());
        if (samples.segments[s].values.cols() > samples.segments[longest].values.cols()) longest = s;
    }
    RecordPeriod result;
    const Index length = samples.segments[longest].values.cols();
    const std::vector<Row> rows = rows_of(samples, coordinates, segments);
    if (rows.empty() || length < 8) return result;
    const double step = sampling_interval(samples, "record_period");
    for (const Row& row : rows)
        result.noise += row.noise_variance / row.variance / static_cast<double>(rows.size());
    result.noise = std::sqrt(result.noise);

    const LagDistance distance(samples, segments, rows);
    std::vector<double> d;
    for (Index lag = 0; lag <= std::min(length / 2 + 2, longest_lag); ++lag) {
        d.push_back(distance.at(lag));
        if (!std::isfinite(d.back())) {
            d.pop_back();
            break;
        }
    }
    if (d.size() < 5) return result;
    const std::vector<Minimum> found = minima(d);
    if (found.empty()) return result;
    const Minimum deepest =
        *std::min_element(found.begin(), found.end(), [](const auto& a, const auto& b) { return a.value < b.value; });
    const Minimum first = *std::find_if(found.begin(), found.end(), [&](const Minimum& one) {
        return one.value <= equally_deep * deepest.value + one.accuracy + deepest.accuracy;
    });
    result.distance = std::min(std::sqrt(first.value), 1.0);
    result.periodic =
        result.distance <= std::max(repeated_share, noise_multiple * result.noise) && result.distance < 0.5;
    double lag = first.lag;
    if (result.periodic) lag = refined_lag(distance, lag, length * 3 / 4);
    result.time = lag * step;
    result.periods = static_cast<double>(length) / lag;
    add_maxima(samples, longest, lag, rows, result);
    return result;
}

std::string description(const RecordPeriod& period, const Series& samples) {
    const auto times = fmt::format("{:.3g} times", period.periods);
    const auto maxima = period.maxima > 0
                            ? fmt::format(" with {} {} of {}", period.maxima, period.maxima == 1 ? "maximum" : "maxima",
                                          samples.coordinate(period.of).name)
                            : std::string();
    if (period.time == 0.0) return "comes back to itself at no lag";
    return fmt::format(
        "{} after {:.6g} s{}, {} within the record; distance {:.2g} % of the readings' sd, {:.2g} % by "
        "their errors",
        period.periodic ? "repeats" : "comes nearest to itself", period.time, maxima, times, 100.0 * period.distance,
        100.0 * period.noise);
}

}  // namespace orbid::orbits
