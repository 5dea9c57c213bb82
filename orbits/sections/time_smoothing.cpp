#include "orbits/sections/time_smoothing.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "models/arithmetic/orthogonal_factor.hpp"
#include "models/system/stopped.hpp"
#include "orbits/records/refusal.hpp"
#include "periodic/orbit/full_turn.hpp"

namespace orbid::orbits {
namespace {

// Orders of differences beyond ten gain nothing: the noise they leave is that of ever fewer independent stretches.
constexpr int highest_difference = 10;

constexpr std::array<int, 4> degrees{1, 3, 5, 7};
constexpr int widest = 128;

// Sampling intervals may differ by this part of one: times in files have a few digits.
constexpr double uneven = 1e-3;

// Samples looked at on either side of a crossing when a window is chosen, and most places used for it.
constexpr Eigen::Index beside = 3;
constexpr std::size_t most_places = 20000;

Eigen::VectorXd unwrapped(const Segment& segment, Eigen::Index coordinate, bool angle) {
    Eigen::VectorXd readings = segment.values.row(coordinate).transpose();
    if (!angle) return readings;
    double before = std::numeric_limits<double>::quiet_NaN();
    for (double& reading : readings) {
        if (!std::isfinite(reading)) continue;
        if (std::isfinite(before)) reading = before + std::remainder(reading - before, periodic::full_turn);
        before = reading;
    }
    return readings;
}

// Powers 0 to degree of t in one row each.
Eigen::MatrixXd powers(const Eigen::VectorXd& t, int degree) {
    Eigen::MatrixXd result(t.size(), degree + 1);
    result.col(0).setOnes();
    for (int d = 1; d <= degree; ++d)
        result.col(d) = result.col(d - 1).cwiseProduct(t);
    return result;
}

Eigen::MatrixXd pseudo_inverse(const Eigen::MatrixXd& design) {
    return models::HouseholderFactor(design).solve(Eigen::MatrixXd::Identity(design.rows(), design.rows()));
}

// Weights of the 2 h neighbours of a sample in the prediction of that sample, nearest before it last and so on in time.
Eigen::VectorXd prediction_weights(TimeWindow window) {
    const int h = window.half_width;
    Eigen::VectorXd t(2 * h);
    for (int j = 0; j < h; ++j) {
        t[j] = static_cast<double>(j - h) / h;
        t[h + j] = static_cast<double>(j + 1) / h;
    }
    return pseudo_inverse(powers(t, window.degree)).row(0).transpose();
}

}  // namespace

double difference_variance(const Series& samples, Eigen::Index coordinate) {
    const bool angle = samples.coordinate(coordinate).angle;
    std::array<double, highest_difference> sums{};
    std::size_t count = 0;
    for (const Segment& segment : samples.segments) {
        const Eigen::VectorXd readings = unwrapped(segment, coordinate, angle);
        for (Eigen::Index i = 0; i + highest_difference < readings.size(); ++i) {
            std::array<double, highest_difference + 1> d{};
            for (int j = 0; j <= highest_difference; ++j)
                d[static_cast<std::size_t>(j)] = readings[i + j];
            if (!std::all_of(d.begin(), d.end(), [](double value) { return std::isfinite(value); })) continue;
            ++count;
            for (std::size_t k = 1; k <= highest_difference; ++k) {
                for (std::size_t j = 0; j + k <= highest_difference; ++j)
                    d[j] = d[j + 1] - d[j];
                sums[k - 1] += d[0] * d[0];
            }
        }
    }
    if (count == 0) return 0.0;
    double least = std::numeric_limits<double>::infinity(), binomial = 1.0;
    for (std::size_t k = 1; k <= highest_difference; ++k) {
        binomial *= 2.0 * (2.0 * static_cast<double>(k) - 1.0) / static_cast<double>(k);
        least = std::min(least, sums[k - 1] / (binomial * static_cast<double>(count)));
    }
    return least;
}

TimeSmoothing::TimeSmoothing(const Segment& segment, Eigen::Index coordinate, bool angle, double step,
                             TimeWindow window)
    : readings_(unwrapped(segment, coordinate, angle)), step_(step), window_(window) {
    const int h = window_.half_width;
    // In units of the half width the powers stay of order one.
    const Eigen::VectorXd t = (Eigen::VectorXd::LinSpaced(2 * h, 0.5 - h, h - 0.5)) / h;
    solver_ = pseudo_inverse(powers(t, window_.degree));
    missing_.reserve(static_cast<std::size_t>(readings_.size()) + 1);
    missing_.push_back(0);
    for (const double reading : readings_)
        missing_.push_back(missing_.back() + (std::isfinite(reading) ? 0 : 1));
}

bool TimeSmoothing::complete(Eigen::Index i) const {
    const Eigen::Index first = i - window_.half_width + 1, end = i + window_.half_width + 1;
    return first >= 0 && end <= readings_.size() &&
           missing_[static_cast<std::size_t>(end)] == missing_[static_cast<std::size_t>(first)];
}

SmoothedValue TimeSmoothing::at(Eigen::Index i, double u) const {
    const int h = window_.half_width;
    const double t = (u - 0.5) / h;
    Eigen::RowVectorXd value(window_.degree + 1), slope(window_.degree + 1);
    for (int d = 0; d <= window_.degree; ++d) {
        value[d] = d == 0 ? 1.0 : value[d - 1] * t;
        slope[d] = d == 0 ? 0.0 : d * value[d - 1];
    }
    SmoothedValue result;
    if (complete(i)) {
        const auto window = readings_.segment(i - h + 1, 2 * h);
        const Eigen::RowVectorXd weights = value * solver_;
        result.value = weights.dot(window);
        result.slope = (slope * solver_).dot(window) / (h * step_);
        result.value_variance = weights.squaredNorm();
        result.usable = true;
        return result;
    }
    std::vector<double> places, readings;
    for (Eigen::Index j = std::max<Eigen::Index>(0, i - h + 1); j <= std::min(readings_.size() - 1, i + h); ++j)
        if (std::isfinite(readings_[j])) {
            places.push_back((static_cast<double>(j - i) - 0.5) / h);
            readings.push_back(readings_[j]);
        }
    const auto count = static_cast<Eigen::Index>(places.size());
    // Half of a window must be there; an interpolation with fewer samples has a lower degree, and a sample to spare, or
    // its weights would grow.
    if (count <= std::max(h, 1)) return result;
    const int degree = std::min(window_.degree, static_cast<int>(count) - 2);
    const Eigen::MatrixXd solver =
        pseudo_inverse(powers(Eigen::Map<const Eigen::VectorXd>(places.data(), count), degree));
    const Eigen::Map<const Eigen::VectorXd> window(readings.data(), count);
    const Eigen::RowVectorXd weights = value.head(degree + 1) * solver;
    result.value = weights.dot(window);
    result.slope = (slope.head(degree + 1) * solver).dot(window) / (h * step_);
    result.value_variance = weights.squaredNorm();
    result.usable = std::isfinite(result.value);
    return result;
}

void check_samples(const Series& samples, const char* caller) {
    refuse_if(samples.sampling != Series::Sampling::samples, "{}: the series holds sections; it needs samples in time",
              caller);
    for (const Segment& segment : samples.segments) {
        refuse_if(segment.values.rows() != samples.dimension() || segment.times.size() != segment.values.cols(),
                  "{}: segment '{}' has {} rows and {} times for {} samples of {} coordinates", caller, segment.label,
                  segment.values.rows(), segment.times.size(), segment.values.cols(), samples.dimension());
    }
}

double sampling_interval(const Series& samples, const char* caller) {
    double step = 0.0;
    for (const Segment& segment : samples.segments) {
        const Eigen::Index m = segment.times.size();
        if (m > 1 && step == 0.0) step = (segment.times[m - 1] - segment.times[0]) / static_cast<double>(m - 1);
    }
    refuse_record_if(!(step > 0.0), "{}: no segment has two samples at ascending times", caller);
    for (const Segment& segment : samples.segments)
        for (Eigen::Index i = 0; i + 1 < segment.times.size(); ++i)
            refuse_record_if(
                !(std::abs(segment.times[i + 1] - segment.times[i] - step) <= uneven * step),
                "{}: segment '{}' goes from {} s to {} s where {} s was the sampling interval; samples must be "
                "equidistant, missing ones nan",
                caller, segment.label, segment.times[i], segment.times[i + 1], step);
    return step;
}

std::vector<std::vector<Eigen::Index>> places_near(const std::vector<std::vector<Eigen::Index>>& marks) {
    std::size_t count = 0;
    for (const auto& own : marks)
        count += own.size() * static_cast<std::size_t>(2 * beside);
    const std::size_t stride = count / most_places + 1;
    std::vector<std::vector<Eigen::Index>> places(marks.size());
    std::size_t number = 0;
    for (std::size_t s = 0; s < marks.size(); ++s)
        for (const Eigen::Index mark : marks[s]) {
            if (number++ % stride != 0) continue;
            for (Eigen::Index i = mark - beside + 1; i <= mark + beside; ++i)
                if (i >= 0) places[s].push_back(i);
        }
    return places;
}

TimeWindow best_window(const Series& samples, Eigen::Index coordinate,
                       const std::vector<std::vector<Eigen::Index>>& places, const std::function<bool()>& interrupted) {
    const bool angle = samples.coordinate(coordinate).angle;
    std::vector<Eigen::VectorXd> readings;
    for (const Segment& segment : samples.segments)
        readings.push_back(unwrapped(segment, coordinate, angle));
    TimeWindow best;
    double smallest = std::numeric_limits<double>::infinity();
    for (const int degree : degrees)
        for (int h = (degree + 1) / 2; h <= widest; h += std::max(1, h / 4)) {
            models::stop_if_asked(interrupted);
            const Eigen::VectorXd weights = prediction_weights({degree, h});
            double sum = 0.0;
            std::size_t count = 0;
            for (std::size_t s = 0; s < places.size(); ++s)
                for (const Eigen::Index i : places[s]) {
                    const Eigen::VectorXd& y = readings[s];
                    if (i < h || i + h >= y.size()) continue;
                    const double error =
                        weights.head(h).dot(y.segment(i - h, h)) + weights.tail(h).dot(y.segment(i + 1, h)) - y[i];
                    if (!std::isfinite(error)) continue;
                    sum += error * error;
                    ++count;
                }
            if (count == 0) continue;
            const double mean = sum / static_cast<double>(count);
            if (mean < smallest) {
                smallest = mean;
                best = {degree, h};
            }
        }
    return best;
}

TimeWindow narrowed(TimeWindow window) {
    const double share = std::pow(0.1, 1.0 / (window.degree + 1.0));
    window.half_width = std::max((window.degree + 1) / 2, static_cast<int>(std::lround(share * window.half_width)));
    return window;
}

}  // namespace orbid::orbits
