#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numeric>

#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

#include "models/arithmetic/splitmix64.hpp"
#include "orbits/cycles/recurrence.hpp"

namespace orbid::orbits {
namespace {

// Points that one task looks at; fixed, so that the result does not depend on the number of threads.
constexpr std::size_t points_per_task = 1 << 15;

struct Recurrence {
    std::uint64_t itinerary;
    float gap;  // largest coordinate of x_{t+p} - x_t
    std::uint32_t start;

    bool operator<(const Recurrence& other) const {
        if (itinerary != other.itinerary) return itinerary < other.itinerary;
        if (gap != other.gap) return gap < other.gap;
        return start < other.start;
    }
};

// Base of the polynomial hash and its inverse modulo 2^64: the hash of the next rotation follows from the last one.
constexpr std::uint64_t base = 0xd1342543de82ef95U;
constexpr std::uint64_t inverse_of(std::uint64_t odd) {
    std::uint64_t inverse = odd;  // right to 3 bits; every round doubles them
    for (int round = 0; round < 6; ++round)
        inverse *= 2 - odd * inverse;
    return inverse;
}
constexpr std::uint64_t base_inverse = inverse_of(base);
static_assert(base * base_inverse == 1);

class ItineraryHash {
public:
    ItineraryHash(const SectionPoints& points, std::size_t period, double cell) : points_(&points), period_(period) {
        for (Eigen::Index d = 0; d < points.dimension(); ++d) {
            const bool angle = points.is_angle(d);
            // An even number around the circle: half a turn, a fixed point of the symmetry, is then in the middle of a
            // cell, as zero is.
            const double cells = angle ? std::max(2.0, 2.0 * std::floor(0.5 / cell)) : 0.0;
            cells_.push_back(cells);
            inverse_edge_.push_back(angle ? cells : 1.0 / cell);
        }
        for (std::size_t j = 0; j + 1 < period; ++j)
            highest_ *= base;
    }

    [[nodiscard]] std::uint64_t operator()(std::size_t start, std::vector<std::uint64_t>& symbols) const {
        std::uint64_t smallest = rotated(start, false, symbols);
        if (points_->symmetric()) smallest = std::min(smallest, rotated(start, true, symbols));
        return smallest;
    }

private:
    // The smallest hash of all rotations.
    [[nodiscard]] std::uint64_t rotated(std::size_t start, bool mirrored, std::vector<std::uint64_t>& symbols) const {
        symbols.resize(period_);
        std::uint64_t hash = 0;
        for (std::size_t j = period_; j-- > 0;) {
            symbols[j] = symbol(points_->point(start + j), mirrored);
            hash = hash * base + symbols[j];
        }
        std::uint64_t smallest = hash;
        for (std::size_t j = 0; j + 1 < period_; ++j) {
            hash = (hash - symbols[j]) * base_inverse + symbols[j] * highest_;
            smallest = std::min(smallest, hash);
        }
        return smallest;
    }

    [[nodiscard]] std::uint64_t symbol(const double* x, bool mirrored) const {
        std::uint64_t hash = 0;
        for (std::size_t d = 0; d < cells_.size(); ++d) {
            const double value = mirrored ? points_->signs()[static_cast<Eigen::Index>(d)] * x[d] : x[d];
            double number = std::floor(value * inverse_edge_[d] + 0.5);
            if (cells_[d] > 0.0 && 2.0 * number >= cells_[d]) number -= cells_[d];
            hash = models::splitmix64(hash ^ static_cast<std::uint64_t>(static_cast<std::int64_t>(number)));
        }
        return hash;
    }

    const SectionPoints* points_;
    std::size_t period_;
    std::vector<double> cells_;  // around the circle; 0: no angle
    std::vector<double> inverse_edge_;
    std::uint64_t highest_ = 1;  // base^(period - 1)
};

// Different itineraries in a sorted list.
std::size_t groups_of(const std::vector<Recurrence>& sorted) {
    std::size_t groups = 0;
    for (std::size_t i = 0; i < sorted.size(); ++i)
        if (i == 0 || sorted[i].itinerary != sorted[i - 1].itinerary) ++groups;
    return groups;
}

}  // namespace

std::vector<RecurrenceSeed> itinerary_seeds(const SectionPoints& points, int period, double box, double cell) {
    const auto p = static_cast<std::size_t>(period);
    if (points.size() <= p) return {};
    const ItineraryHash itinerary(points, p, cell);
    const std::size_t blocks = (points.size() - p + points_per_task - 1) / points_per_task;
    // use(start, gap) for the recurrent points of a block.
    const auto each_recurrent = [&](std::size_t b, const auto& use) {
        points.stop_if_asked();
        const std::size_t first = b * points_per_task, end = std::min(points.size() - p, first + points_per_task);
        std::size_t run = 0;  // images that lead up to point i + p without a break
        for (std::size_t i = first + p; i-- > first && points.has_image(i);)
            ++run;
        for (std::size_t i = first; i < end; ++i) {
            const bool whole = run >= p;
            run = points.has_image(i + p) ? run + 1 : 0;
            if (!whole) continue;
            const double gap = points.largest_difference(i + p, i);
            if (gap <= box) use(i, gap);
        }
    };
    // Counted first: lists that grow would take the memory twice.
    std::vector<std::size_t> slot(blocks + 1, 0);
    tbb::parallel_for(std::size_t{0}, blocks, [&](std::size_t b) {
        std::size_t count = 0;
        each_recurrent(b, [&](std::size_t, double) { ++count; });
        slot[b + 1] = count;
    });
    std::partial_sum(slot.begin(), slot.end(), slot.begin());
    std::vector<Recurrence> all(slot.back());
    tbb::parallel_for(std::size_t{0}, blocks, [&](std::size_t b) {
        std::vector<std::uint64_t> symbols;
        Recurrence* next = all.data() + slot[b];
        each_recurrent(b, [&](std::size_t i, double gap) {
            *next++ = {itinerary(i, symbols), static_cast<float>(gap), static_cast<std::uint32_t>(i)};
        });
    });
    tbb::parallel_sort(all.begin(), all.end());

    std::vector<RecurrenceSeed> seeds;
    seeds.reserve(groups_of(all));
    for (std::size_t i = 0; i < all.size();) {
        std::size_t end = i + 1;
        while (end < all.size() && all[end].itinerary == all[i].itinerary)
            ++end;
        seeds.push_back({all[i].start, end - i});
        i = end;
    }
    std::sort(seeds.begin(), seeds.end(),
              [](const RecurrenceSeed& a, const RecurrenceSeed& b) { return a.start < b.start; });
    return seeds;
}

}  // namespace orbid::orbits
