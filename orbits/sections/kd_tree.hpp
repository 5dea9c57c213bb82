#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <limits>
#include <memory>
#include <span>
#include <vector>

namespace orbid::orbits {

/// The nearest points found so far, in a list that is shortened from time to time.
///
/// Distances are those of rounded coordinates: limit() allows for the rounding, so that the points kept always include
/// the k nearest by exact distances, sometimes with a few more.
class NearestCandidates {
public:
    /// @param k         >= 1 points are wanted.
    /// @param rounding  upper bound of the error of a distance.
    NearestCandidates(std::size_t k, float rounding);
    NearestCandidates(const NearestCandidates&) = delete;
    NearestCandidates& operator=(const NearestCandidates&) = delete;

    [[nodiscard]] float limit() const { return limit_; }  ///< squared distance beyond which no point need be added

    /// Adds those of `count` points that are within the limit. `distance2` not negative.
    void add(const float* distance2, const std::uint32_t* ids, std::size_t count);

    /// Removes points beyond the limit set by the points found so far.
    void tighten();

    /// Points added from now on form a second list; this does not affect which of the k nearest are wanted.
    void part() { second_ = size_; }

    /// The points that may be among the k nearest; after tighten() hardly any others.
    [[nodiscard]] std::span<const std::uint32_t> first() const { return {ids_, std::min(second_, size_)}; }
    [[nodiscard]] std::span<const std::uint32_t> second() const {
        return {ids_ + std::min(second_, size_), size_ - std::min(second_, size_)};
    }

private:
    void reserve(std::size_t count);
    [[nodiscard]] float reach_of_k() const;

    static constexpr std::size_t few = 512;  // points that need no memory from the heap: enough for 200 neighbours

    std::size_t k_;
    float margin_;
    float limit_;
    std::size_t size_ = 0;
    std::size_t second_ = std::numeric_limits<std::size_t>::max();  // where the second list begins
    std::size_t full_;                                              // the list is shortened when it is longer
    std::size_t capacity_ = few;
    // Deliberately uninitialised: a query must not write 4 KB first.
    std::array<float, few> own_distances_;
    std::array<std::uint32_t, few> own_ids_;
    std::unique_ptr<float[]> more_distances_;
    std::unique_ptr<std::uint32_t[]> more_ids_;
    float* distances_;  // squared
    std::uint32_t* ids_;
};

/// Places of the numbers when sorted, equal ones in input order; for lists of some tens.
/// Cost: O(count^2), but eight at a time and without a branch: faster than sorting up to about 100.
void rank(const double* numbers, std::size_t count, std::uint32_t* places);

/// Points with 32-bit coordinates, sorted into boxes of few points by halving: a balanced tree of tight boxes.
///
/// Coordinates are on circles of 2^32: differences are those of unsigned numbers, read as signed ones. A straight axis
/// must use less than half of the circle. Holds 4 (n + 1) bytes per point and about n / 3 for the boxes. Const and
/// thread-safe after construction.
class KdTree {
public:
    KdTree() = default;
    /// @param quanta   length of one unit of each coordinate, > 0; n of them.
    /// @param records  count x (n coordinates, id): point after point. Sorted in place. Cost: O(count log count),
    /// parallel; no memory beyond the tree. Results depend neither on the order of the records nor on the number of
    /// threads.
    /// @param interrupted  asked while sorting; @throws models::Stopped if it says so
    KdTree(std::vector<float> quanta, std::unique_ptr<std::uint32_t[]> records, std::size_t count,
           const std::function<bool()>& interrupted);

    /// Adds the points that may be among the k nearest to a place (n coordinates).
    void collect(const std::uint32_t* place, NearestCandidates& candidates) const;

    [[nodiscard]] std::size_t size() const { return count_; }
    [[nodiscard]] float rounding() const { return rounding_; }  ///< of distances: one quantum in every coordinate

private:
    template <int n>
    void sort(std::size_t node, std::size_t first_leaf, std::size_t leaves, const std::function<bool()>& interrupted);
    template <int n>
    void search(const std::uint32_t* place, NearestCandidates& candidates) const;

    [[nodiscard]] std::size_t first_point(std::size_t leaf) const { return (leaf * count_) >> depth_; }
    [[nodiscard]] std::size_t dimension() const { return quanta_.size(); }

    std::vector<float> quanta_;
    float rounding_ = 0.0F;
    std::size_t count_ = 0;
    int depth_ = 0;                             ///< 2^depth leaves
    std::unique_ptr<std::uint32_t[]> records_;  ///< leaf after leaf: coordinate after coordinate, then the ids
    std::vector<std::uint32_t> boxes_;  ///< node after node (root = 1, children 2 i, 2 i + 1): centre, half edges
};

}  // namespace orbid::orbits
