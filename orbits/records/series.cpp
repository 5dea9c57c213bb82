#include "orbits/records/series.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <functional>
#include <limits>
#include <numbers>

#include <tbb/blocked_range.h>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

namespace orbid::orbits {
namespace {

/// Share of the values that the range leaves out at either end: 0.1 %, so that single wild readings of a long record
/// do not set the unit of distance.
constexpr double tail = 0.001;

// Selection stops dividing when so few values are left that sorting them costs nothing.
constexpr std::size_t few = 1 << 14;
constexpr unsigned bin_bits = 12;

/// Numbers in the order of the values: finite doubles as integers.
std::uint64_t key_of(double value) {
    const auto bits = std::bit_cast<std::uint64_t>(value == 0.0 ? 0.0 : value);  // -0 equals 0
    constexpr std::uint64_t sign = std::uint64_t{1} << 63;
    return (bits & sign) != 0 ? ~bits : bits | sign;
}

double value_of_key(std::uint64_t key) {
    constexpr std::uint64_t sign = std::uint64_t{1} << 63;
    return std::bit_cast<double>((key & sign) != 0 ? key & ~sign : ~key);
}

/// The finite values of one coordinate, read again and again instead of being copied: a record may fill the memory.
class CoordinateValues {
public:
    CoordinateValues(const Series& series, Eigen::Index coordinate) : coordinate_(coordinate) {
        constexpr Eigen::Index length = 1 << 14;
        for (const Segment& segment : series.segments)
            for (Eigen::Index first = 0; first < segment.values.cols(); first += length)
                pieces_.push_back({&segment, first, std::min(first + length, segment.values.cols())});
    }

    /// combine(part) for every part = collect(part, key of value) over some pieces, in any order.
    template <class Part, class Collect, class Combine>
    void visit(const Part& empty, const Collect& collect, const Combine& combine) const {
        tbb::enumerable_thread_specific<Part> parts(empty);
        tbb::parallel_for(tbb::blocked_range<std::size_t>(0, pieces_.size()),
                          [&](const tbb::blocked_range<std::size_t>& range) {
                              Part& part = parts.local();
                              for (std::size_t p = range.begin(); p < range.end(); ++p)
                                  for (Eigen::Index k = pieces_[p].first; k < pieces_[p].last; ++k) {
                                      const double value = pieces_[p].segment->values(coordinate_, k);
                                      if (std::isfinite(value)) collect(part, key_of(value));
                                  }
                          });
        for (const Part& part : parts)
            combine(part);
    }

private:
    struct Piece {
        const Segment* segment;
        Eigen::Index first, last;
    };
    Eigen::Index coordinate_;
    std::vector<Piece> pieces_;
};

struct Extent {
    std::uint64_t lowest = std::numeric_limits<std::uint64_t>::max();
    std::uint64_t highest = 0;
    std::size_t count = 0;
    void join(const Extent& other) {
        lowest = std::min(lowest, other.lowest);
        highest = std::max(highest, other.highest);
        count += other.count;
    }
};

/// Values below the rank-th (from 0) of those in [extent.lowest, extent.highest], by counting into ever smaller bins.
std::uint64_t select(const CoordinateValues& values, Extent extent, std::size_t rank) {
    while (extent.count > few && extent.lowest < extent.highest) {
        const std::uint64_t lowest = extent.lowest, highest = extent.highest;
        const auto width = static_cast<unsigned>(std::bit_width(highest - lowest));
        const unsigned shift = width > bin_bits ? width - bin_bits : 0;
        using Bins = std::vector<std::size_t>;
        Bins bins(std::size_t{1} << bin_bits, 0);
        values.visit(
            bins,
            [&](Bins& part, std::uint64_t key) {
                if (key >= lowest && key <= highest) ++part[(key - lowest) >> shift];
            },
            [&](const Bins& part) {
                std::transform(part.begin(), part.end(), bins.begin(), bins.begin(), std::plus{});
            });
        std::size_t bin = 0;
        while (rank >= bins[bin])
            rank -= bins[bin++];
        extent.lowest = lowest + (static_cast<std::uint64_t>(bin) << shift);
        extent.highest = std::min(highest, extent.lowest + ((std::uint64_t{1} << shift) - 1));
        extent.count = bins[bin];
    }
    if (extent.lowest == extent.highest) return extent.lowest;
    std::vector<std::uint64_t> left;
    values.visit(
        std::vector<std::uint64_t>(),
        [&](std::vector<std::uint64_t>& part, std::uint64_t key) {
            if (key >= extent.lowest && key <= extent.highest) part.push_back(key);
        },
        [&](const std::vector<std::uint64_t>& part) { left.insert(left.end(), part.begin(), part.end()); });
    const auto middle = left.begin() + static_cast<std::ptrdiff_t>(rank);
    std::nth_element(left.begin(), middle, left.end());
    return *middle;
}

/// Empirical quantile at position share * (count - 1), linear between neighbours. Not empty.
double quantile(const CoordinateValues& values, const Extent& extent, double share) {
    const double position = share * static_cast<double>(extent.count - 1);
    const auto rank = static_cast<std::size_t>(std::floor(position));
    const std::uint64_t at = select(values, extent, rank);
    if (rank + 1 == extent.count) return value_of_key(at);
    Extent above;  // and how many are not
    values.visit(
        Extent{},
        [at](Extent& part, std::uint64_t key) {
            if (key > at)
                part.lowest = std::min(part.lowest, key);
            else
                ++part.count;
        },
        [&](const Extent& part) { above.join(part); });
    const double next = value_of_key(above.count > rank + 1 ? at : above.lowest);
    return value_of_key(at) + (position - static_cast<double>(rank)) * (next - value_of_key(at));
}

}  // namespace

std::size_t Series::size() const {
    std::size_t points = 0;
    for (const Segment& segment : segments)
        points += static_cast<std::size_t>(segment.values.cols());
    return points;
}

bool Series::timed() const {
    if (sampling == Sampling::samples) return true;
    return !segments.empty() && std::all_of(segments.begin(), segments.end(), [](const Segment& segment) {
        return segment.times.size() > 0 && segment.times.size() == segment.values.cols();
    });
}

Eigen::VectorXd Series::scale() const {
    Eigen::VectorXd scale(dimension());
    for (Eigen::Index i = 0; i < dimension(); ++i) {
        scale[i] = 2.0 * std::numbers::pi;
        if (coordinate(i).angle) continue;
        const CoordinateValues values(*this, i);
        Extent extent;
        values.visit(
            Extent{},
            [](Extent& part, std::uint64_t key) {
                part.join({key, key, 1});
            },
            [&](const Extent& part) { extent.join(part); });
        const double range =
            extent.count == 0 ? 0.0 : quantile(values, extent, 1.0 - tail) - quantile(values, extent, tail);
        // A constant coordinate separates no states: any unit does, and 1 keeps distances finite.
        scale[i] = range > 0.0 ? range : 1.0;
    }
    return scale;
}

}  // namespace orbid::orbits
