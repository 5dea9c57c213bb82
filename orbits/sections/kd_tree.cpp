#include "orbits/sections/kd_tree.hpp"

#include <cmath>
#include <utility>

#include <tbb/parallel_invoke.h>

#include "models/system/stopped.hpp"
#include "orbits/sections/point_records.hpp"

namespace orbid::orbits {
namespace {

// Points of a leaf at most, at least half as many. Fewer mean more boxes to ask, more mean more distances to compute:
// measured at 2^20 points, 16 takes a third longer, 32 and 64 the same; boxes cost less memory the fewer there are.
constexpr std::size_t leaf_points = 48;

// Distances of a leaf are computed in groups of this many: whole registers, reading past the leaf's end.
constexpr std::size_t group = 8;

// Floats: conversion, scaling, squaring and summing lose less than this share of a squared distance.
constexpr float float_rounding = 4e-6F;

// Below this many points a task costs more than it saves.
constexpr std::size_t task_points = 1 << 13;

}  // namespace

NearestCandidates::NearestCandidates(std::size_t k, float rounding)
    : k_(k),
      margin_(2.0F * rounding),
      limit_(std::numeric_limits<float>::infinity()),
      full_(k),
      distances_(own_distances_.data()),
      ids_(own_ids_.data()) {
    reserve(2 * k + 2 * leaf_points);
}

void NearestCandidates::reserve(std::size_t count) {
    if (count <= capacity_) return;
    capacity_ = 2 * count;
    auto distances = std::make_unique_for_overwrite<float[]>(capacity_);
    auto ids = std::make_unique_for_overwrite<std::uint32_t[]>(capacity_);
    std::copy_n(distances_, size_, distances.get());
    std::copy_n(ids_, size_, ids.get());
    more_distances_ = std::move(distances);
    more_ids_ = std::move(ids);
    distances_ = more_distances_.get();
    ids_ = more_ids_.get();
}

void NearestCandidates::add(const float* distance2, const std::uint32_t* ids, std::size_t count) {
    reserve(size_ + count);
    std::size_t size = size_;
    const float limit = limit_;
    for (std::size_t i = 0; i < count; ++i) {
        distances_[size] = distance2[i];  // without a branch: whether it stays nobody can foretell
        ids_[size] = ids[i];
        size += distance2[i] <= limit ? 1 : 0;
    }
    size_ = size;
    if (size_ >= full_) tighten();
}

// A squared distance within which at least k of the points lie, and hardly more. Numbers of points within a squared
// distance grow smoothly with it, so interpolation finds it in a few counts.
float NearestCandidates::reach_of_k() const {
    float low = -1.0F, high = 0.0F;
    for (std::size_t i = 0; i < size_; ++i)
        high = std::max(high, distances_[i]);
    std::size_t below = 0, within = size_;  // points within low and within high
    for (int step = 0; step < 24 && within > k_ + k_ / 16 + 1; ++step) {
        // Interpolated first; where points lie in clumps, halving goes on.
        const float share =
            step < 4 ? (static_cast<float>(k_ - below) + 0.5F) / static_cast<float>(within - below + 1) : 0.5F;
        const float trial = std::max(low, 0.0F) + share * (high - std::max(low, 0.0F));
        if (!(trial > low && trial < high)) break;
        int count = 0;
        for (std::size_t i = 0; i < size_; ++i)
            count += distances_[i] <= trial ? 1 : 0;
        if (static_cast<std::size_t>(count) >= k_) {
            high = trial;
            within = static_cast<std::size_t>(count);
        } else {
            low = trial;
            below = static_cast<std::size_t>(count);
        }
    }
    return high;
}

void NearestCandidates::tighten() {
    if (size_ < k_) return;
    // k points lie within this distance + rounding, so whoever is nearer than they shows at most twice that more.
    const float reach = std::sqrt(reach_of_k()) + margin_;
    limit_ = std::min(limit_, reach * reach * (1.0F + float_rounding));
    std::size_t size = 0;
    const auto keep = [&](std::size_t from, std::size_t to) {
        for (std::size_t i = from; i < to; ++i) {
            const float distance2 = distances_[i];
            distances_[size] = distance2;
            ids_[size] = ids_[i];
            size += distance2 <= limit_ ? 1 : 0;
        }
    };
    if (second_ <= size_) {
        keep(0, second_);
        const std::size_t first = size;
        keep(second_, size_);
        second_ = first;
    } else {
        keep(0, size_);
    }
    size_ = size;
    // Equal distances cannot be told apart here: with many of them the list may grow.
    full_ = std::max(k_, size_) + std::max<std::size_t>(leaf_points, k_ / 2);
}

void rank(const double* numbers, std::size_t count, std::uint32_t* places) {
    for (std::size_t i = 0; i < count; ++i) {
        const double number = numbers[i];
        std::int64_t before = 0;
        for (std::size_t j = 0; j < i; ++j)
            before += numbers[j] <= number ? 1 : 0;
        for (std::size_t j = i + 1; j < count; ++j)
            before += numbers[j] < number ? 1 : 0;
        places[i] = static_cast<std::uint32_t>(before);
    }
}

KdTree::KdTree(std::vector<float> quanta, std::unique_ptr<std::uint32_t[]> records, std::size_t count,
               const std::function<bool()>& interrupted)
    : quanta_(std::move(quanta)), count_(count), records_(std::move(records)) {
    float squares = 0.0F;
    for (const float quantum : quanta_)
        squares += quantum * quantum;
    rounding_ = 1.01F * std::sqrt(squares);
    while ((leaf_points << depth_) < count_)
        ++depth_;
    boxes_.resize((std::size_t{2} << depth_) * 2 * dimension());
    if (count_ == 0) return;
    const std::size_t leaves = std::size_t{1} << depth_;
    switch (dimension()) {
        case 1:
            sort<1>(1, 0, leaves, interrupted);
            break;
        case 2:
            sort<2>(1, 0, leaves, interrupted);
            break;
        case 3:
            sort<3>(1, 0, leaves, interrupted);
            break;
        default:
            sort<0>(1, 0, leaves, interrupted);
    }
}

template <int n>
void KdTree::sort(std::size_t node, std::size_t first_leaf, std::size_t leaves,
                  const std::function<bool()>& interrupted) {
    const std::size_t width = n > 0 ? static_cast<std::size_t>(n) : dimension();
    const PointRecords<n> records{records_.get(), width + 1};
    const std::size_t first = first_point(first_leaf), last = first_point(first_leaf + leaves);
    std::uint32_t* const box = boxes_.data() + node * 2 * width;
    std::size_t widest = 0;
    float largest = -1.0F;
    for (std::size_t d = 0; d < width; ++d) {
        std::uint32_t lowest = records.key(first, d), highest = lowest;
        for (std::size_t i = first; i < last; ++i) {
            lowest = std::min(lowest, records.key(i, d));
            highest = std::max(highest, records.key(i, d));
        }
        const std::uint32_t half = (highest - lowest) / 2;
        box[d] = lowest + half;
        box[width + d] = highest - lowest - half;  // the larger half
        const float edge = static_cast<float>(highest - lowest) * quanta_[d];
        if (edge > largest) {
            largest = edge;
            widest = d;
        }
    }
    if (leaves > 1) {
        if (last - first > task_points) models::stop_if_asked(interrupted);
        const std::size_t middle = first_point(first_leaf + leaves / 2);
        select_record(records, widest, static_cast<std::ptrdiff_t>(first), static_cast<std::ptrdiff_t>(last) - 1,
                      static_cast<std::ptrdiff_t>(middle));
        const auto lower = [&] { sort<n>(2 * node, first_leaf, leaves / 2, interrupted); };
        const auto upper = [&] { sort<n>(2 * node + 1, first_leaf + leaves / 2, leaves / 2, interrupted); };
        if (last - first > task_points) {
            tbb::parallel_invoke(lower, upper);
        } else {
            lower();
            upper();
        }
        return;
    }
    // Coordinate after coordinate, so that a register takes several points.
    const std::size_t count = last - first;
    std::vector<std::uint32_t> transposed(count * (width + 1));
    for (std::size_t i = 0; i < count; ++i)
        for (std::size_t c = 0; c <= width; ++c)
            transposed[c * count + i] = records.at(first + i)[c];
    std::copy(transposed.begin(), transposed.end(), records.at(first));
}

void KdTree::collect(const std::uint32_t* place, NearestCandidates& candidates) const {
    if (count_ == 0) return;
    switch (dimension()) {
        case 1:
            return search<1>(place, candidates);
        case 2:
            return search<2>(place, candidates);
        case 3:
            return search<3>(place, candidates);
        default:
            return search<0>(place, candidates);
    }
}

template <int n>
void KdTree::search(const std::uint32_t* place, NearestCandidates& candidates) const {
    const std::size_t width = n > 0 ? static_cast<std::size_t>(n) : dimension();
    const float* const quanta = quanta_.data();
    // From the place to the nearest point of a box, squared: beyond its half edges from its centre.
    const auto away = [&](std::size_t node) {
        const std::uint32_t* const box = boxes_.data() + node * 2 * width;
        float sum = 0.0F;
        for (std::size_t d = 0; d < width; ++d) {
            const std::uint32_t turn = place[d] - box[d];
            const std::uint32_t apart = std::min(turn, 0U - turn);
            const std::uint32_t beyond = std::max(apart, box[width + d]) - box[width + d];
            const float r = static_cast<float>(static_cast<std::int32_t>(beyond)) * quanta[d];
            sum += r * r;
        }
        return sum;
    };
    const auto ask = [&](std::size_t leaf) {
        const std::size_t first = first_point(leaf), count = first_point(leaf + 1) - first;
        const std::uint32_t* const x = records_.get() + first * (width + 1);
        alignas(32) std::array<float, leaf_points> distance2;
        for (std::size_t j = 0; j < count; j += group)
            for (std::size_t i = j; i < j + group; ++i) {
                float sum = 0.0F;
                for (std::size_t d = 0; d < width; ++d) {
                    const float r =
                        static_cast<float>(static_cast<std::int32_t>(x[d * count + i] - place[d])) * quanta[d];
                    sum += r * r;
                }
                distance2[i] = sum;
            }
        candidates.add(distance2.data(), x + width * count, count);
    };

    struct Later {
        std::size_t node;
        float distance2;
    };
    std::array<Later, 34> later;  // one per level at most: a tree of 2^32 points has 27
    std::size_t waiting = 0;
    const std::size_t leaves = std::size_t{1} << depth_;
    std::size_t node = 1;
    for (;;) {
        while (node < leaves) {
            const float left = away(2 * node), right = away(2 * node + 1);
            const bool swap = right < left;
            const float farther = swap ? left : right;
            later[waiting] = {2 * node + (swap ? 0U : 1U), farther};
            waiting += farther <= candidates.limit() ? 1 : 0;
            node = 2 * node + (swap ? 1U : 0U);
        }
        ask(node - leaves);
        for (;;) {
            if (waiting == 0) return;
            const Later& next = later[--waiting];
            if (!(next.distance2 <= candidates.limit())) continue;
            node = next.node;
            break;
        }
    }
}

}  // namespace orbid::orbits
