#include "orbits/sections/section_points.hpp"
#include "orbits/records/refusal.hpp"

#include <limits>
#include <numbers>
#include <stdexcept>
#include <type_traits>
#include <utility>

#include <tbb/parallel_for.h>

namespace orbid::orbits {
namespace {

constexpr double two_pi = 2.0 * std::numbers::pi;

// More than one turn by more than this: readings of a wrapped angle may reach both ends of its interval and a little
// further by noise or by an offset added after wrapping.
constexpr double wrapped_range = 1.25;

// turns = winding_numbers + the rest in [-1/2, 1/2).
double winding_numbers(double turns) {
    const double whole = std::nearbyint(turns);
    return turns - whole >= 0.5 ? whole + 1.0 : whole;
}

double wrapped_turns(double turns) {
    return turns - winding_numbers(turns);
}

constexpr std::size_t points_per_block = 1 << 14;  // points that one task takes: whole words of bits

// The points of all segments as one list, by blocks that can be worked on side by side.
class Blocks {
public:
    Blocks(const Series& series, const std::function<bool()>& interrupted)
        : series_(&series), interrupted_(&interrupted) {
        for (const Segment& segment : series.segments) {
            first_.push_back(size_);
            size_ += static_cast<std::size_t>(segment.values.cols());
        }
    }
    [[nodiscard]] std::size_t size() const { return size_; }
    [[nodiscard]] std::size_t count() const { return (size_ + points_per_block - 1) / points_per_block; }

    // body(b, i, segment, column) for every point i of every block b.
    template <class Body>
    void each(const Body& body) const {
        tbb::parallel_for(std::size_t{0}, count(), [&](std::size_t b) {
            models::stop_if_asked(interrupted_);
            const std::size_t last = std::min(size_, (b + 1) * points_per_block);
            auto s = static_cast<std::size_t>(std::upper_bound(first_.begin(), first_.end(), b * points_per_block) -
                                              first_.begin() - 1);
            for (std::size_t i = b * points_per_block; i < last; ++s) {
                const Segment& segment = series_->segments[s];
                const std::size_t end = std::min(last, first_[s] + static_cast<std::size_t>(segment.values.cols()));
                for (; i < end; ++i)
                    body(b, i, segment, static_cast<Eigen::Index>(i - first_[s]));
            }
        });
    }

private:
    const Series* series_;
    const std::function<bool()>* interrupted_;
    std::vector<std::size_t> first_;  // point of each segment
    std::size_t size_ = 0;
};

// Highest minus lowest finite reading of every coordinate; negative when there is none.
Eigen::VectorXd ranges_of(const Blocks& blocks, Eigen::Index n) {
    const auto count = static_cast<Eigen::Index>(blocks.count());
    constexpr double infinity = std::numeric_limits<double>::infinity();
    Eigen::MatrixXd lowest = Eigen::MatrixXd::Constant(n, count, infinity);
    Eigen::MatrixXd highest = Eigen::MatrixXd::Constant(n, count, -infinity);
    blocks.each([&](std::size_t b, std::size_t, const Segment& segment, Eigen::Index column) {
        const auto at = static_cast<Eigen::Index>(b);
        for (Eigen::Index d = 0; d < n; ++d) {
            const double value = segment.values(d, column);
            if (!std::isfinite(value)) continue;
            lowest(d, at) = std::min(lowest(d, at), value);
            highest(d, at) = std::max(highest(d, at), value);
        }
    });
    if (count == 0) return Eigen::VectorXd::Constant(n, -infinity);
    return highest.rowwise().maxCoeff() - lowest.rowwise().minCoeff();
}

// Of crossings that were told by samples. A sd of 0, of samples without errors, is known, too.
bool knows_errors(const Series& series) {
    return series.timed() && std::all_of(series.segments.begin(), series.segments.end(), [&](const Segment& segment) {
               const Eigen::Index n = segment.values.rows(), m = segment.values.cols();
               const auto fits = [&](const Eigen::MatrixXd& one) { return one.rows() == n && one.cols() == m; };
               return fits(segment.deviations) && fits(segment.rates) && segment.time_deviations.size() == m &&
                      segment.rates.allFinite() && segment.time_deviations.allFinite() &&
                      segment.deviations.allFinite();
           });
}

// SectionPoints::error_root() by its diagonal and last column.
void keep_errors(const Segment& segment, Eigen::Index column, const Eigen::VectorXd& scale, double* errors) {
    const Eigen::Index n = scale.size();
    for (Eigen::Index d = 0; d < n; ++d) {
        const double moved = segment.rates(d, column) * segment.time_deviations[column];
        const double all = segment.deviations(d, column);
        errors[d] = std::sqrt(std::max(all * all - moved * moved, 0.0)) / scale[d];
        errors[n + d] = moved / scale[d];
    }
    errors[2 * n] = segment.time_deviations[column];
}

void check_shape(const Series& series, const std::optional<std::vector<double>>& signs) {
    refuse_if(series.sampling != Series::Sampling::section,
              "find_cycles: the series holds time samples; it needs sections");
    const Eigen::Index n = series.dimension();
    if (n < 1) throw std::invalid_argument("find_cycles: the series has no coordinates");
    for (const Segment& segment : series.segments)
        refuse_if(segment.values.rows() != n, "find_cycles: segment '{}' has {} rows, the series {} coordinates",
                  segment.label, segment.values.rows(), n);
    if (!signs) return;
    refuse_if(static_cast<Eigen::Index>(signs->size()) != n,
              "find_cycles: symmetry_signs has {} entries, the series {} coordinates", signs->size(), n);
    for (const double sign : *signs)
        refuse_if(!(sign == 1.0 || sign == -1.0), "find_cycles: symmetry_signs must be +1 or -1, got {:f}", sign);
}

}  // namespace

SectionPoints::SectionPoints(const Series& series, const std::optional<std::vector<double>>& signs,
                             Eigen::VectorXd scale, std::function<bool()> interrupted)
    : interrupted_(std::move(interrupted)) {
    check_shape(series, signs);
    const auto n = static_cast<std::size_t>(series.dimension());
    if (signs) signs_ = Eigen::Map<const Eigen::VectorXd>(signs->data(), static_cast<Eigen::Index>(n));
    for (const SeriesCoordinate& coordinate : series.coordinates) {
        angle_.push_back(coordinate.angle ? 1 : 0);
        angle_count_ += coordinate.angle ? 1 : 0;
    }
    scale_ = scale.size() > 0 ? std::move(scale) : series.scale();
    turns_known_ = angle_count_ > 0;
    const Blocks blocks(series, interrupted_);
    const Eigen::VectorXd ranges = ranges_of(blocks, series.dimension());
    for (std::size_t d = 0; d < n; ++d) {
        const double range = ranges[static_cast<Eigen::Index>(d)];
        refuse_record_if(!(range > 0.0) || !(scale_[static_cast<Eigen::Index>(d)] > 0.0),
                         "find_cycles: coordinate '{}' has no spread", series.coordinates[d].name);
        if (angle_[d] && !(range > wrapped_range * two_pi)) turns_known_ = false;
    }

    size_ = blocks.size();
    values_ = std::make_unique_for_overwrite<double[]>(size_ * n);
    has_image_.assign((size_ + 63) / 64, 0);
    if (series.timed()) times_.resize(size_);
    if (turns_known_) turns_.resize(size_ * angle_count_);
    if (knows_errors(series)) errors_.resize(size_ * (2 * n + 1));
    std::vector<std::size_t> images(blocks.count(), 0);
    std::vector<char> too_many(blocks.count(), 0);  // turns to be stored
    blocks.each([&](std::size_t b, std::size_t i, const Segment& segment, Eigen::Index column) {
        for (std::size_t d = 0; d < n; ++d) {
            const auto row = static_cast<Eigen::Index>(d);
            const double scaled = segment.values(row, column) / scale_[row];
            values_[i * n + d] = angle_[d] ? wrapped_turns(scaled) : scaled;
        }
        if (!times_.empty()) times_[i] = segment.times[column];
        if (!errors_.empty()) keep_errors(segment, column, scale_, &errors_[i * (2 * n + 1)]);
        if (!(column + 1 < segment.values.cols() && segment.values.col(column).allFinite() &&
              segment.values.col(column + 1).allFinite()))
            return;
        has_image_[i / 64] |= std::uint64_t{1} << (i % 64);
        ++images[b];
        if (!turns_known_) return;
        for (std::size_t d = 0, a = 0; d < n; ++d) {
            if (!angle_[d]) continue;
            const auto row = static_cast<Eigen::Index>(d);
            const double whole = winding_numbers(segment.values(row, column + 1) / scale_[row]) -
                                 winding_numbers(segment.values(row, column) / scale_[row]);
            if (std::abs(whole) <= std::numeric_limits<std::int16_t>::max())
                turns_[i * angle_count_ + a] = static_cast<std::int16_t>(whole);
            else
                too_many[b] = 1;
            ++a;
        }
    });
    for (std::size_t b = 0; b < blocks.count(); ++b) {
        image_count_ += images[b];
        if (too_many[b]) turns_known_ = false;
    }
}

SectionPoints SectionPoints::stretch(std::size_t first, std::size_t count) const {
    SectionPoints part;
    part.scale_ = scale_;
    part.signs_ = signs_;
    part.angle_ = angle_;
    part.angle_count_ = angle_count_;
    part.turns_known_ = turns_known_;
    part.interrupted_ = interrupted_;
    part.size_ = count;
    const auto n = static_cast<std::size_t>(scale_.size()), per_error = 2 * n + 1;
    part.values_ = std::make_unique_for_overwrite<double[]>(count * n);
    std::copy_n(point(first), count * n, part.values_.get());
    const auto cut = [&](const auto& whole, std::size_t per_point) {
        using Part = std::decay_t<decltype(whole)>;
        if (whole.empty()) return Part();
        const auto begin = whole.begin() + static_cast<std::ptrdiff_t>(first * per_point);
        return Part(begin, begin + static_cast<std::ptrdiff_t>(count * per_point));
    };
    part.turns_ = cut(turns_, angle_count_);
    part.times_ = cut(times_, 1);
    part.errors_ = cut(errors_, per_error);
    part.has_image_.assign((count + 63) / 64, 0);
    for (std::size_t i = 0; i + 1 < count; ++i) {
        if (!has_image(first + i)) continue;
        part.has_image_[i / 64] |= std::uint64_t{1} << (i % 64);
        ++part.image_count_;
    }
    return part;
}

Eigen::MatrixXd SectionPoints::error_root(std::size_t i) const {
    const Eigen::Index n = dimension();
    const Eigen::Map<const Eigen::VectorXd> own(&errors_[i * static_cast<std::size_t>(2 * n + 1)], 2 * n + 1);
    Eigen::MatrixXd root = Eigen::MatrixXd::Zero(n + 1, n + 1);
    root.diagonal().head(n) = own.head(n);
    root.col(n) = own.tail(n + 1);
    return root;
}

Eigen::VectorXd SectionPoints::difference(const Eigen::VectorXd& a, const Eigen::VectorXd& b) const {
    Eigen::VectorXd result(a.size());
    for (Eigen::Index d = 0; d < a.size(); ++d)
        result[d] = difference(a[d], b[d], d);
    return result;
}

Eigen::VectorXd SectionPoints::wrapped(Eigen::VectorXd x) const {
    for (Eigen::Index d = 0; d < x.size(); ++d)
        x[d] = wrapped(x[d], d);
    return x;
}

double SectionPoints::advance(std::size_t i, Eigen::Index angle_coordinate) const {
    const auto d = static_cast<std::size_t>(angle_coordinate);
    const auto before = static_cast<std::size_t>(std::count_if(
        angle_.begin(), angle_.begin() + static_cast<std::ptrdiff_t>(d), [](char angle) { return angle != 0; }));
    return turns_[i * angle_count_ + before] + point(i + 1)[d] - point(i)[d];
}

}  // namespace orbid::orbits
