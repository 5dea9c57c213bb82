#pragma once

#include <functional>
#include <vector>

#include <Eigen/Core>

#include "orbits/records/series.hpp"

namespace orbid::orbits {

/// A polynomial in time through samples around an interval: degree, and samples on either side of its middle.
struct TimeWindow {
    int degree = 1;
    int half_width = 1;  ///< 2 half_width >= degree + 1
};

/// Variance of the errors of one coordinate's samples, estimated from their differences in time. It is the smallest
/// over the orders k = 1 to 10 of the mean square of the k-th differences over binomial(2 k, k). A motion smooth over
/// ten samples adds nothing to the higher orders; otherwise the result is an upper bound. Angles are unwrapped from
/// sample to sample. 0 when no stretch of 11 samples is complete.
[[nodiscard]] double difference_variance(const Series& samples, Eigen::Index coordinate);

/// Value and slope of a coordinate at an instant.
struct SmoothedValue {
    double value = 0.0;
    double slope = 0.0;           ///< per second
    double value_variance = 0.0;  ///< for unit variance of a sample
    bool usable = false;          ///< false: too few samples present

    /// Ends of segments and holes leave variances beyond 1.5.
    [[nodiscard]] bool reliable() const { return usable && value_variance <= 1.5; }
};

/// Local polynomials in time (Savitzky and Golay 1964) through the samples of one coordinate of one segment.
///
/// The window around the interval [i, i + 1] holds the samples i - h + 1 to i + h; missing ones are left out (an
/// interpolation then has a lower degree). At the ends of a segment it holds those that exist, at least half. With 2
/// h = degree + 1 it is an interpolation. Angles are unwrapped from one sample to the next, across missing ones the
/// shorter way. Keeps a reference to the segment.
class TimeSmoothing {
public:
    /// @param window  see TimeWindow. @param step [s] sampling interval, > 0.
    TimeSmoothing(const Segment& segment, Eigen::Index coordinate, bool angle, double step, TimeWindow window);

    /// At a place u in units of the sampling interval, 0 = sample i, 1 = sample i + 1.
    [[nodiscard]] SmoothedValue at(Eigen::Index i, double u) const;
    /// Readings, unwrapped if an angle; nan = missing.
    [[nodiscard]] const Eigen::VectorXd& readings() const { return readings_; }

private:
    [[nodiscard]] bool complete(Eigen::Index i) const;

    Eigen::VectorXd readings_;
    double step_;
    TimeWindow window_;
    Eigen::MatrixXd solver_;             ///< shape (degree + 1, 2 h): coefficients from a complete window
    std::vector<Eigen::Index> missing_;  ///< number of missing readings before each sample
};

/// Refuses sections, and segments whose values and times do not fit the series.
/// @param caller  begins the messages. @throws std::invalid_argument
void check_samples(const Series& samples, const char* caller);

/// The common sampling interval [s].
/// @throws DataError for samples that are not equidistant, or no two samples in a segment.
[[nodiscard]] double sampling_interval(const Series& samples, const char* caller);

/// Three samples on either side of the intervals after the given ones, per segment; thinned evenly to 20 000.
[[nodiscard]] std::vector<std::vector<Eigen::Index>> places_near(const std::vector<std::vector<Eigen::Index>>& marks);

/// The window whose polynomials predict held-out samples best: each of the given samples is predicted by the h samples
/// on either side without it. Degrees 1, 3, 5, 7, half widths up to 128. Places without a complete widest window are
/// used for the windows that are complete.
///
/// @param places       per segment: samples where the polynomials will be used.
/// @param interrupted  asked for every window. @throws models::Stopped if it says so
[[nodiscard]] TimeWindow best_window(const Series& samples, Eigen::Index coordinate,
                                     const std::vector<std::vector<Eigen::Index>>& places,
                                     const std::function<bool()>& interrupted = {});

/// A narrower window, in which a polynomial of this degree misses a tenth: half width times 10^(-1 / (degree + 1)).
/// The variance of its values grows by a third (degree 7) to three quarters (degree 3). best_window() weighs what is
/// missed against the noise of one place; maps and cycles average over many places, and then what is missed remains.
[[nodiscard]] TimeWindow narrowed(TimeWindow window);

}  // namespace orbid::orbits
