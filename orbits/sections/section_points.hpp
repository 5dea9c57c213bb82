#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include <Eigen/Core>

#include "models/system/stopped.hpp"
#include "orbits/records/series.hpp"

namespace orbid::orbits {

/// The points of a section series in units of Series::scale(), in order, ready for neighbour searches.
///
/// Memory: 8 n + 1/8 bytes per point, 2 more per angle with known turns, 8 more for times, 16 n + 8 for their
/// errors.
///
/// Angles are turns in [-1/2, 1/2): use difference() for the difference of two points. The image of a point is its
/// successor: point i is mapped to point i + 1 when has_image(i).
class SectionPoints {
public:
    /// @param signs  S = diag(signs): sections are mapped onto each other by x -> S x. Empty: no symmetry.
    /// @param scale  units, shape (n), > 0; empty: Series::scale().
    /// @param interrupted  asked by whatever works on these points, and now; if it says so, models::Stopped is thrown.
    /// @throws std::invalid_argument for a series of time samples, one without coordinates, segments of another
    ///         dimension, signs of wrong length or other than +1 and -1; DataError for coordinates without spread.
    explicit SectionPoints(const Series& series, const std::optional<std::vector<double>>& signs = std::nullopt,
                           Eigen::VectorXd scale = {}, std::function<bool()> interrupted = {});

    /// `count` successive points from `first` as a section of its own.
    [[nodiscard]] SectionPoints stretch(std::size_t first, std::size_t count) const;

    [[nodiscard]] Eigen::Index dimension() const { return scale_.size(); }
    [[nodiscard]] std::size_t size() const { return size_; }
    [[nodiscard]] const double* point(std::size_t i) const {
        return values_.get() + i * static_cast<std::size_t>(scale_.size());
    }
    /// Point i + 1 is the image of point i: both finite and in the same segment.
    [[nodiscard]] bool has_image(std::size_t i) const { return ((has_image_[i / 64] >> (i % 64)) & 1U) != 0; }
    [[nodiscard]] std::size_t image_count() const { return image_count_; }
    [[nodiscard]] const Eigen::VectorXd& scale() const { return scale_; }  ///< [coordinate unit per scaled unit]
    [[nodiscard]] const std::vector<char>& angle() const { return angle_; }
    [[nodiscard]] bool is_angle(Eigen::Index d) const { return angle_[static_cast<std::size_t>(d)] != 0; }
    [[nodiscard]] const Eigen::VectorXd& signs() const { return signs_; }  ///< empty: no symmetry
    [[nodiscard]] bool symmetric() const { return signs_.size() > 0; }

    /// @throws models::Stopped if a stop is asked for
    void stop_if_asked() const { models::stop_if_asked(interrupted_); }
    [[nodiscard]] const std::function<bool()>& interrupted() const { return interrupted_; }

    /// a - b in coordinate d; angles: the representative in [-1/2, 1/2].
    [[nodiscard]] double difference(double a, double b, Eigen::Index d) const {
        const double r = a - b;
        // rounding is a call on some processors, and neighbours are near
        return angle_[static_cast<std::size_t>(d)] && !(std::abs(r) <= 0.5) ? r - std::nearbyint(r) : r;
    }
    /// a - b, shape (n).
    [[nodiscard]] Eigen::VectorXd difference(const Eigen::VectorXd& a, const Eigen::VectorXd& b) const;
    /// Largest coordinate of the difference of two points.
    [[nodiscard]] double largest_difference(std::size_t i, std::size_t j) const {
        double largest = 0.0;
        for (Eigen::Index d = 0; d < dimension(); ++d)
            largest = std::max(largest, std::abs(difference(point(i)[d], point(j)[d], d)));
        return largest;
    }
    /// The same value of coordinate d, an angle in [-1/2, 1/2).
    [[nodiscard]] double wrapped(double value, Eigen::Index d) const {
        if (!angle_[static_cast<std::size_t>(d)] || (value >= -0.5 && value < 0.5)) return value;
        const double r = value - std::nearbyint(value);
        return r >= 0.5 ? r - 1.0 : r;
    }
    /// The same state with angles in [-1/2, 1/2).
    [[nodiscard]] Eigen::VectorXd wrapped(Eigen::VectorXd x) const;
    /// Turns taken by an angle from point i to its image, as read; meaningful only when turns_known() and has_image(i).
    [[nodiscard]] double advance(std::size_t i, Eigen::Index angle_coordinate) const;
    /// From point i to its image [s]; meaningful only when timed() and has_image(i).
    [[nodiscard]] double return_time(std::size_t i) const { return times_[i + 1] - times_[i]; }
    [[nodiscard]] bool timed() const { return !times_.empty(); }
    /// Errors of all points and times are known (Segment::time_deviations).
    [[nodiscard]] bool errors_known() const { return !errors_.empty(); }
    /// A root of the covariance of point i (scaled units) and its time [s], shape (n + 1, n + 1): the own error of
    /// every coordinate, then that of the time, which moves all of them. Meaningful only when errors_known().
    [[nodiscard]] Eigen::MatrixXd error_root(std::size_t i) const;
    /// All angles were read without wrapping (their readings cover more than one turn), so turns can be counted: up to
    /// 32767 from a point to its image.
    [[nodiscard]] bool turns_known() const { return turns_known_; }

private:
    SectionPoints() = default;

    Eigen::VectorXd scale_;
    Eigen::VectorXd signs_;
    std::vector<char> angle_;
    std::size_t size_ = 0;
    std::unique_ptr<double[]> values_;  ///< point after point
    std::vector<std::int16_t> turns_;   ///< whole turns on the way to the image, per angle; empty unless turns_known_
    std::vector<double> times_;         ///< [s] of all points; empty unless the series has them
    std::vector<double> errors_;        ///< per point: own sds, what the time's error adds, its sd; empty: not known
    std::vector<std::uint64_t> has_image_;  ///< one bit per point
    std::size_t image_count_ = 0;
    std::size_t angle_count_ = 0;
    bool turns_known_ = false;
    std::function<bool()> interrupted_;
};

}  // namespace orbid::orbits
