#include "orbits/section_points.hpp"

#include <algorithm>
#include <limits>
#include <numbers>
#include <stdexcept>
#include <string>

namespace orbid::orbits {

namespace {

constexpr double two_pi = 2.0 * std::numbers::pi;

// More than one turn by more than this: readings of a wrapped angle may reach both ends of its interval and a little
// further by noise or by an offset added after wrapping.
constexpr double wrapped_range = 1.25;

double wrapped_turns(double turns) {
    const double r = turns - std::nearbyint(turns);
    return r >= 0.5 ? r - 1.0 : r;
}

// Highest minus lowest finite reading; negative when there is none.
double range_of(const Series& series, Eigen::Index coordinate) {
    double lowest = std::numeric_limits<double>::infinity(), highest = -lowest;
    for (const Segment& segment : series.segments)
        for (Eigen::Index i = 0; i < segment.values.cols(); ++i) {
            const double value = segment.values(coordinate, i);
            if (!std::isfinite(value)) continue;
            lowest = std::min(lowest, value);
            highest = std::max(highest, value);
        }
    return highest - lowest;
}

void check_shape(const Series& series, const std::optional<std::vector<double>>& signs) {
    if (series.sampling != Series::Sampling::section)
        throw std::invalid_argument("find_cycles: the series holds time samples; it needs sections");
    const Eigen::Index n = series.dimension();
    if (n < 1) throw std::invalid_argument("find_cycles: the series has no coordinates");
    for (const Segment& segment : series.segments)
        if (segment.values.rows() != n)
            throw std::invalid_argument("find_cycles: segment '" + segment.label + "' has " +
                                        std::to_string(segment.values.rows()) + " rows, the series " +
                                        std::to_string(n) + " coordinates");
    if (!signs) return;
    if (static_cast<Eigen::Index>(signs->size()) != n)
        throw std::invalid_argument("find_cycles: symmetry_signs has " + std::to_string(signs->size()) +
                                    " entries, the series " + std::to_string(n) + " coordinates");
    for (const double sign : *signs)
        if (!(sign == 1.0 || sign == -1.0))
            throw std::invalid_argument("find_cycles: symmetry_signs must be +1 or -1, got " + std::to_string(sign));
}

}  // namespace

SectionPoints::SectionPoints(const Series& series, const std::optional<std::vector<double>>& signs) {
    check_shape(series, signs);
    const auto n = static_cast<std::size_t>(series.dimension());
    if (signs) signs_ = Eigen::Map<const Eigen::VectorXd>(signs->data(), static_cast<Eigen::Index>(n));
    for (const SeriesCoordinate& coordinate : series.coordinates) {
        angle_.push_back(coordinate.angle ? 1 : 0);
        angle_count_ += coordinate.angle ? 1 : 0;
    }
    scale_ = series.scale();
    turns_known_ = angle_count_ > 0;
    for (std::size_t d = 0; d < n; ++d) {
        const double range = range_of(series, static_cast<Eigen::Index>(d));
        if (!(range > 0.0) || !(scale_[static_cast<Eigen::Index>(d)] > 0.0))
            throw std::invalid_argument("find_cycles: coordinate '" + series.coordinates[d].name + "' has no spread");
        if (angle_[d] && !(range > wrapped_range * two_pi)) turns_known_ = false;
    }

    const std::size_t count = series.size();
    values_.reserve(count * n);
    has_image_.reserve(count);
    const bool timed = series.timed();
    for (const Segment& segment : series.segments)
        for (Eigen::Index i = 0; i < segment.values.cols(); ++i) {
            for (std::size_t d = 0; d < n; ++d) {
                const auto row = static_cast<Eigen::Index>(d);
                const double scaled = segment.values(row, i) / scale_[row];
                values_.push_back(angle_[d] ? wrapped_turns(scaled) : scaled);
                if (angle_[d] && turns_known_) turns_.push_back(scaled);
            }
            if (timed) times_.push_back(segment.times[i]);
            const bool image = i + 1 < segment.values.cols() && segment.values.col(i).allFinite() &&
                               segment.values.col(i + 1).allFinite();
            has_image_.push_back(image ? 1 : 0);
            image_count_ += image ? 1 : 0;
        }
}

Eigen::VectorXd SectionPoints::difference(const Eigen::VectorXd& a, const Eigen::VectorXd& b) const {
    Eigen::VectorXd result(a.size());
    for (Eigen::Index d = 0; d < a.size(); ++d)
        result[d] = difference(a[d], b[d], d);
    return result;
}

Eigen::VectorXd SectionPoints::wrapped(Eigen::VectorXd x) const {
    for (Eigen::Index d = 0; d < x.size(); ++d)
        if (angle_[static_cast<std::size_t>(d)]) x[d] = wrapped_turns(x[d]);
    return x;
}

double SectionPoints::advance(std::size_t i, Eigen::Index angle_coordinate) const {
    std::size_t column = 0;
    for (Eigen::Index d = 0; d < angle_coordinate; ++d)
        column += angle_[static_cast<std::size_t>(d)] ? 1 : 0;
    return turns_[(i + 1) * angle_count_ + column] - turns_[i * angle_count_ + column];
}

}  // namespace orbid::orbits
