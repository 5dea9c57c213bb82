#include "orbits/sections/sampled_section.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <stdexcept>
#include <utility>

#include <fmt/format.h>

#include "models/definition/parameter.hpp"
#include "models/system/stopped.hpp"
#include "orbits/records/refusal.hpp"
#include "periodic/orbit/full_turn.hpp"

namespace orbid::orbits {
namespace {

// Standard deviations of the smoothed coordinate by which a crossing must pass the plane on either side.
constexpr double passed = 3.0;

// Sds of samples, over the range, up to which windows are narrowed. Beyond, more noise costs a search its cycles:
// Lorenz at 1 % has six cycles up to period 4 in the best windows, one in narrowed ones; at 0.2 % none is lost.
constexpr double quiet = 5e-3;

// Samples between two questions whether to stop.
constexpr Eigen::Index asked_every = 65536;

// Pieces of one segment without a break.
class PieceWriter {
public:
    PieceWriter(SampledSection& section, const Segment& source, Eigen::Index dimension)
        : section_(section), source_(source), dimension_(dimension) {}

    struct Point {
        double time, time_deviation;
        Eigen::VectorXd state, deviation, rate;
    };
    void add(Point point) { points_.push_back(std::move(point)); }
    void close() {
        if (points_.empty()) return;
        Segment piece;
        piece.label = pieces_ == 0 ? source_.label : fmt::format("{}.{}", source_.label, pieces_);
        const auto m = static_cast<Eigen::Index>(points_.size());
        piece.values.resize(dimension_, m);
        piece.deviations.resize(dimension_, m);
        piece.rates.resize(dimension_, m);
        piece.times.resize(m);
        piece.time_deviations.resize(m);
        for (Eigen::Index k = 0; k < m; ++k) {
            const Point& point = points_[static_cast<std::size_t>(k)];
            piece.values.col(k) = point.state;
            piece.deviations.col(k) = point.deviation;
            piece.rates.col(k) = point.rate;
            piece.times[k] = point.time;
            piece.time_deviations[k] = point.time_deviation;
        }
        section_.series.segments.push_back(std::move(piece));
        ++pieces_;
        points_.clear();
    }

private:
    SampledSection& section_;
    const Segment& source_;
    Eigen::Index dimension_;
    std::size_t pieces_ = 0;
    std::vector<Point> points_;
};

struct Passage {
    Eigen::Index interval = 0;  // between this sample and the next
    bool broken_before = false;
};

class PlaneSection {
public:
    PlaneSection(const Series& samples, const PlaneCrossing& crossing, const std::function<bool()>& interrupted)
        : samples_(samples),
          crossing_(crossing),
          interrupted_(interrupted),
          step_(sampling_interval(samples, "plane_section")) {
        const Eigen::Index n = samples.dimension();
        const auto marks = rough_crossings();
        const auto places = places_near(marks);
        result_.sample_deviation.resize(n);
        for (Eigen::Index d = 0; d < n; ++d) {
            models::stop_if_asked(interrupted_);
            result_.sample_deviation[d] = std::sqrt(difference_variance(samples, d));
            result_.windows.push_back(best_window(samples, d, places, interrupted_));
            if (d != crossing.coordinate) result_.series.coordinates.push_back(samples.coordinate(d));
        }
        if ((result_.sample_deviation.array() <= quiet * samples.scale().array()).all())
            std::transform(result_.windows.begin(), result_.windows.end(), result_.windows.begin(), narrowed);
        result_.series.origin = samples.origin;
        result_.reading_covariance = Eigen::MatrixXd::Zero(n - 1, n - 1);
        for (const Segment& segment : samples.segments)
            cut(segment);
        const std::size_t count = result_.series.size();
        if (count > 0) result_.reading_covariance /= static_cast<double>(count);
    }

    SampledSection result() && { return std::move(result_); }

private:
    // Signed distance from the plane along the direction of the crossing; nan far from it on the circle.
    [[nodiscard]] double beyond(double reading) const {
        double distance = reading - crossing_.value;
        if (samples_.coordinate(crossing_.coordinate).angle) distance = std::remainder(distance, periodic::full_turn);
        return crossing_.direction * distance;
    }
    [[nodiscard]] bool far(double distance) const {
        return samples_.coordinate(crossing_.coordinate).angle && !(std::abs(distance) < 0.25 * periodic::full_turn);
    }

    // Intervals in which the readings as they are cross the plane.
    [[nodiscard]] std::vector<std::vector<Eigen::Index>> rough_crossings() const {
        std::vector<std::vector<Eigen::Index>> marks(samples_.segments.size());
        bool any = false;
        for (std::size_t s = 0; s < marks.size(); ++s) {
            const Readings& values = samples_.segments[s].values;
            for (Eigen::Index i = 0; i + 1 < values.cols(); ++i) {
                const double before = beyond(values(crossing_.coordinate, i));
                const double after = beyond(values(crossing_.coordinate, i + 1));
                if (!(before < 0.0 && after >= 0.0) || far(before) || far(after)) continue;
                marks[s].push_back(i);
                any = true;
            }
        }
        refuse_record_if(!any, "plane_section: {} = {} is never crossed {}",
                         samples_.coordinate(crossing_.coordinate).name, crossing_.value,
                         crossing_.direction > 0 ? "from below" : "from above");
        return marks;
    }

    void cut(const Segment& segment) {
        std::vector<TimeSmoothing> smoothings;
        for (Eigen::Index d = 0; d < samples_.dimension(); ++d) {
            models::stop_if_asked(interrupted_);
            smoothings.emplace_back(segment, d, samples_.coordinate(d).angle, step_,
                                    result_.windows[static_cast<std::size_t>(d)]);
        }
        PieceWriter writer(result_, segment, samples_.dimension() - 1);
        for (const Passage& passage : passages(smoothings[static_cast<std::size_t>(crossing_.coordinate)])) {
            if (passage.broken_before) {
                writer.close();
                ++result_.breaks;
            }
            if (passage.interval < 0) continue;
            if (!add(segment, smoothings, passage.interval, writer)) {
                writer.close();
                ++result_.breaks;
            }
        }
        writer.close();
    }

    // Crossings for good, in order; interval -1: only a break.
    [[nodiscard]] std::vector<Passage> passages(const TimeSmoothing& plane) const {
        const auto c = static_cast<std::size_t>(crossing_.coordinate);
        const Eigen::VectorXd& readings = plane.readings();
        const double sd = result_.sample_deviation[crossing_.coordinate];
        const Eigen::Index bridge = std::max(1, result_.windows[c].half_width / 2);
        std::vector<Passage> found;
        int side = 0;                 // -1: below the plane for good, 1: beyond it for good
        Eigen::Index candidate = -1;  // interval of the last passage since then
        Eigen::Index gap = 0;         // missing samples up to here
        bool broken = false;
        double before = std::numeric_limits<double>::quiet_NaN();
        for (Eigen::Index i = 0; i + 1 < readings.size(); ++i) {
            if (i % asked_every == 0) models::stop_if_asked(interrupted_);
            gap = std::isfinite(readings[i]) ? 0 : gap + 1;
            const SmoothedValue smoothed = plane.at(i, 0.0);
            const bool known = smoothed.reliable() && gap <= bridge;
            const double distance = known ? beyond(smoothed.value) : std::numeric_limits<double>::quiet_NaN();
            if (!known || far(distance)) {
                // Far on the circle nothing is crossed; in a hole nobody knows.
                broken = broken || (!known && (side != 0 || !found.empty()));
                side = 0;
                candidate = -1;
                before = std::numeric_limits<double>::quiet_NaN();
                continue;
            }
            if (before < 0.0 && distance >= 0.0) candidate = i - 1;
            before = distance;
            const double limit = passed * sd * std::sqrt(smoothed.value_variance);
            if (distance >= limit) {
                if (side < 0 && candidate >= 0) {
                    found.push_back({candidate, broken});
                    broken = false;
                } else if (side > 0 && candidate >= 0) {
                    broken = true;  // below and back within the errors
                }
                side = 1;
                candidate = -1;
            } else if (distance <= -limit) {
                if (side < 0 && candidate >= 0) broken = true;  // beyond and back within the errors
                side = -1;
                candidate = -1;
            }
        }
        return found;
    }

    // false: the crossing is not told well enough.
    bool add(const Segment& segment, const std::vector<TimeSmoothing>& smoothings, Eigen::Index i,
             PieceWriter& writer) {
        const TimeSmoothing& plane = smoothings[static_cast<std::size_t>(crossing_.coordinate)];
        const std::optional<double> u = root(plane, i);
        if (!u) return false;
        const SmoothedValue at_plane = plane.at(i, *u);
        const double sd = result_.sample_deviation[crossing_.coordinate];
        const double time_variance = sd * sd * at_plane.value_variance / (at_plane.slope * at_plane.slope);
        const Eigen::Index n = samples_.dimension() - 1;
        Eigen::VectorXd state(n), slope(n), own(n);
        for (Eigen::Index d = 0, k = 0; d < samples_.dimension(); ++d) {
            if (d == crossing_.coordinate) continue;
            const SmoothedValue smoothed = smoothings[static_cast<std::size_t>(d)].at(i, *u);
            if (!smoothed.reliable()) return false;
            const bool angle = samples_.coordinate(d).angle;
            state[k] = angle ? models::wrapped(smoothed.value) : smoothed.value;
            slope[k] = smoothed.slope;
            own[k] = std::pow(result_.sample_deviation[d], 2) * smoothed.value_variance;
            ++k;
        }
        const Eigen::MatrixXd covariance =
            Eigen::MatrixXd(own.asDiagonal()) + time_variance * slope * slope.transpose();
        if (!covariance.allFinite()) return false;
        result_.reading_covariance += covariance;
        // Samples without any error still have rounding: a deviation is never 0.
        const Eigen::VectorXd deviation = covariance.diagonal().cwiseSqrt().cwiseMax(
            std::numeric_limits<double>::epsilon() * state.cwiseAbs().cwiseMax(1e-300));
        writer.add({segment.times[i] + *u * step_, std::sqrt(time_variance), state, deviation, slope});
        return true;
    }

    // Where in the interval the polynomial meets the plane, in sampling intervals. Noise may put it a little outside.
    [[nodiscard]] std::optional<double> root(const TimeSmoothing& plane, Eigen::Index i) const {
        double u = 0.5;
        for (int step = 0; step < 50; ++step) {
            const SmoothedValue value = plane.at(i, u);
            if (!value.usable || !(value.slope * crossing_.direction > 0.0)) return std::nullopt;
            const double move = -beyond(value.value) / (crossing_.direction * value.slope * step_);
            u = std::clamp(u + move, -1.0, 2.0);
            if (std::abs(move) < 1e-13 || (step > 10 && std::abs(move) < 1e-9)) return u;
        }
        return std::nullopt;
    }

    const Series& samples_;
    PlaneCrossing crossing_;
    const std::function<bool()>& interrupted_;
    double step_;
    SampledSection result_;
};

}  // namespace

SampledSection plane_section(const Series& samples, const PlaneCrossing& crossing,
                             const std::function<bool()>& interrupted) {
    check_samples(samples, "plane_section");
    const Eigen::Index n = samples.dimension();
    refuse_if(n < 2, "plane_section: needs at least two coordinates, got {}", n);
    refuse_if(!(crossing.coordinate >= 0 && crossing.coordinate < n),
              "plane_section: the coordinate must be in [0, {}), got {}", n, crossing.coordinate);
    refuse_if(!(crossing.direction == 1 || crossing.direction == -1),
              "plane_section: the direction must be 1 or -1, got {}", crossing.direction);
    if (!std::isfinite(crossing.value)) throw std::invalid_argument("plane_section: the value must be finite");
    return PlaneSection(samples, crossing, interrupted).result();
}

}  // namespace orbid::orbits
