#include "orbits/sections/neighbour_index.hpp"
#include "orbits/records/refusal.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <utility>

#include <tbb/parallel_for.h>

namespace orbid::orbits {
namespace {

constexpr double circle = 4294967296.0;  // 2^32 quanta, on which the tree's coordinates live

// A straight axis takes the middle quarter of the circle: places as far as the whole range outside of it still lie
// less than half a circle from every point.
constexpr double straight_share = 0.25;

constexpr std::size_t points_per_task = 1 << 14;  // points that one task rounds

constexpr auto nearer = [](const Neighbour& a, const Neighbour& b) {
    if (a.distance2 != b.distance2) return a.distance2 < b.distance2;
    if (a.index != b.index) return a.index < b.index;
    return !a.mirrored && b.mirrored;
};

void prefetch([[maybe_unused]] const double* address) {
#ifdef __GNUC__
    __builtin_prefetch(address);
#endif
}

template <class Body>
void each_block(const SectionPoints& points, const Body& body) {
    const std::size_t count = points.size();
    tbb::parallel_for(std::size_t{0}, (count + points_per_task - 1) / points_per_task, [&](std::size_t b) {
        points.stop_if_asked();
        body(b, b * points_per_task, std::min(count, (b + 1) * points_per_task));
    });
}

}  // namespace

NeighbourIndex::NeighbourIndex(const SectionPoints& points) : points_(&points) {
    refuse_if(points.size() >= std::numeric_limits<std::uint32_t>::max(), "find_cycles: more than 2^32 - 2 points");
    const auto n = static_cast<std::size_t>(points.dimension());
    const std::size_t blocks = (points.size() + points_per_task - 1) / points_per_task;
    // Per block: points with an image, lowest and highest coordinates.
    std::vector<std::size_t> slot(blocks + 1, 0);
    std::vector<double> lowest(blocks * n, std::numeric_limits<double>::infinity());
    std::vector<double> highest(blocks * n, -std::numeric_limits<double>::infinity());
    each_block(points, [&](std::size_t b, std::size_t first, std::size_t last) {
        for (std::size_t i = first; i < last; ++i) {
            if (!points.has_image(i)) continue;
            ++slot[b + 1];
            const double* x = points.point(i);
            for (std::size_t d = 0; d < n; ++d) {
                lowest[b * n + d] = std::min(lowest[b * n + d], x[d]);
                highest[b * n + d] = std::max(highest[b * n + d], x[d]);
            }
        }
    });
    for (std::size_t b = 0; b < blocks; ++b) {
        slot[b + 1] += slot[b];
        for (std::size_t d = 0; d < n; ++d) {
            lowest[d] = std::min(lowest[d], lowest[b * n + d]);
            highest[d] = std::max(highest[d], highest[b * n + d]);
        }
    }
    std::vector<float> quanta;
    for (std::size_t d = 0; d < n; ++d) {
        const bool angle = points.angle()[d] != 0;
        const double range = slot.back() > 0 ? highest[d] - lowest[d] : 0.0;
        per_unit_.push_back(angle ? circle : straight_share * circle / (range > 0.0 ? range : 1.0));
        origin_.push_back(angle || !(range > 0.0) ? (angle ? -0.5 : (slot.back() > 0 ? lowest[d] : 0.0) - 1.5)
                                                  : lowest[d] - 1.5 * range);
        quanta.push_back(static_cast<float>(1.0 / per_unit_.back()));
    }

    const std::size_t count = slot.back();
    // Distances of a leaf are computed in whole registers: 8 numbers beyond the last point may be read.
    auto records = std::make_unique_for_overwrite<std::uint32_t[]>(count * (n + 1) + 8);
    std::fill_n(records.get() + count * (n + 1), 8, 0U);
    each_block(points, [&](std::size_t b, std::size_t first, std::size_t last) {
        std::uint32_t* record = records.get() + slot[b] * (n + 1);
        for (std::size_t i = first; i < last; ++i) {
            if (!points.has_image(i)) continue;
            (void)rounded(points.point(i), record);
            record[n] = static_cast<std::uint32_t>(i);
            record += n + 1;
        }
    });
    tree_ = KdTree(std::move(quanta), std::move(records), count, points.interrupted());
}

// False: the place lies so far outside that its differences to the points do not fit.
bool NeighbourIndex::rounded(const double* place, std::uint32_t* result) const {
    for (std::size_t d = 0; d < origin_.size(); ++d) {
        const double quanta = std::nearbyint((place[d] - origin_[d]) * per_unit_[d]);
        if (points_->angle()[d]) {
            // [-1/2, 1/2) on the whole circle; 2^32 is 0 again
            if (!(quanta >= 0.0 && quanta <= circle)) return false;
            result[d] = static_cast<std::uint32_t>(static_cast<std::uint64_t>(quanta));
        } else {
            if (!(quanta >= 0.125 * circle && quanta <= 0.875 * circle)) return false;
            result[d] = static_cast<std::uint32_t>(quanta);
        }
    }
    return true;
}

double NeighbourIndex::distance2(const double* place, std::uint32_t index) const {
    const double* x = points_->point(index);
    double sum = 0.0;
    for (Eigen::Index d = 0; d < points_->dimension(); ++d) {
        const double r = points_->difference(x[d], place[d], d);
        sum += r * r;
    }
    return sum;
}

// For places far outside.
void NeighbourIndex::ask_all(const Eigen::VectorXd& place, std::size_t k, std::vector<Neighbour>& found) const {
    const Eigen::VectorXd mirror =
        points_->symmetric() ? points_->wrapped(points_->signs().cwiseProduct(place)) : Eigen::VectorXd();
    for (std::size_t i = 0; i < points_->size(); ++i) {
        if (!points_->has_image(i)) continue;
        const auto index = static_cast<std::uint32_t>(i);
        found.push_back({distance2(place.data(), index), index, false});
        if (points_->symmetric()) found.push_back({distance2(mirror.data(), index), index, true});
        if (found.size() < 2 * k + 1024) continue;
        std::nth_element(found.begin(), found.begin() + static_cast<std::ptrdiff_t>(k), found.end(), nearer);
        found.resize(k);
    }
    std::sort(found.begin(), found.end(), nearer);
}

// Nearest first; no more than k.
void NeighbourIndex::sort(std::size_t k, std::vector<Neighbour>& found) const {
    constexpr std::size_t some = 128;  // more are sorted faster by comparing pairs
    const std::size_t count = found.size();
    if (count > some) {
        std::sort(found.begin(), found.end(), nearer);
    } else {
        std::array<double, some> distances{};
        std::array<std::uint32_t, some> places;
        for (std::size_t i = 0; i < count; ++i)
            distances[i] = found[i].distance2;
        rank(distances.data(), count, places.data());
        found.resize(2 * count);
        for (std::size_t i = 0; i < count; ++i)
            found[count + places[i]] = found[i];
        found.erase(found.begin(), found.begin() + static_cast<std::ptrdiff_t>(count));
        for (std::size_t i = 1; i < count; ++i)
            if (found[i].distance2 == found[i - 1].distance2) {  // rare
                std::sort(found.begin(), found.end(), nearer);
                break;
            }
    }
    if (count > k) found.resize(k);
}

std::vector<Neighbour> NeighbourIndex::nearest(const Eigen::VectorXd& place, std::size_t k) const {
    std::vector<Neighbour> found;
    nearest(place, k, found);
    return found;
}

void NeighbourIndex::nearest(const Eigen::VectorXd& place, std::size_t k, std::vector<Neighbour>& found) const {
    found.clear();
    points_->stop_if_asked();
    const bool symmetric = points_->symmetric();
    k = std::min(k, tree_.size() * (symmetric ? 2 : 1));
    if (k == 0 || !place.allFinite()) return;
    constexpr std::size_t small = 8;  // coordinates that need no memory from the heap
    const auto n = static_cast<std::size_t>(points_->dimension());
    std::array<double, 2 * small> few;
    std::array<std::uint32_t, 2 * small> few_rounded;
    std::vector<double> many(n > small ? 2 * n : 0);
    std::vector<std::uint32_t> many_rounded(many.size());
    double* const home = n > small ? many.data() : few.data();
    double* const mirror = home + n;
    std::uint32_t* const home_rounded = n > small ? many_rounded.data() : few_rounded.data();
    std::uint32_t* const mirror_rounded = home_rounded + n;
    for (std::size_t d = 0; d < n; ++d) {
        const auto row = static_cast<Eigen::Index>(d);
        home[d] = points_->wrapped(place[row], row);
        // Mirrored copies are not stored: |S x - y| = |x - S y|, so the mirrored place is asked instead.
        if (symmetric) mirror[d] = points_->wrapped(points_->signs()[row] * home[d], row);
    }
    if (!rounded(home, home_rounded) || (symmetric && !rounded(mirror, mirror_rounded))) {
        ask_all(Eigen::Map<const Eigen::VectorXd>(home, points_->dimension()), k, found);
        if (found.size() > k) found.resize(k);
        return;
    }
    NearestCandidates candidates(k, tree_.rounding());
    tree_.collect(home_rounded, candidates);
    candidates.part();
    if (symmetric) tree_.collect(mirror_rounded, candidates);
    candidates.tighten();
    // Asked for all at once: every point comes from another corner of the memory.
    for (const std::uint32_t id : candidates.first())
        prefetch(points_->point(id));
    for (const std::uint32_t id : candidates.second())
        prefetch(points_->point(id));
    for (const std::uint32_t id : candidates.first())
        found.push_back({distance2(home, id), id, false});
    for (const std::uint32_t id : candidates.second())
        found.push_back({distance2(mirror, id), id, true});
    sort(k, found);
}

}  // namespace orbid::orbits
