#include "orbits/box_grid.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

namespace orbid::orbits {

namespace {

// Points per box when they filled the range evenly. Attractors do not, so occupied boxes hold a few times more; then
// the 32 nearest come from about 3 x 3 boxes. Measured at 2^20 points: 2 and 8 are both slower than 4.
constexpr double points_per_box = 4.0;

bool nearer(const Neighbour& a, const Neighbour& b) {
    if (a.distance2 != b.distance2) return a.distance2 < b.distance2;
    if (a.index != b.index) return a.index < b.index;
    return !a.mirrored && b.mirrored;
}

}  // namespace

BoxGrid::BoxGrid(const SectionPoints& points) : points_(&points) {
    if (points.size() >= std::numeric_limits<std::uint32_t>::max())
        throw std::invalid_argument("find_cycles: more than 2^32 - 2 points");
    const auto n = static_cast<std::size_t>(points.dimension());
    gridded_ = std::min(n, maximum_gridded);
    const double count = static_cast<double>(std::max<std::size_t>(points.image_count(), 1));
    const double per_coordinate = std::pow(count / points_per_box, 1.0 / static_cast<double>(gridded_));
    const auto boxes = std::clamp<std::int64_t>(static_cast<std::int64_t>(per_coordinate), 1, 1 << 24);
    for (std::size_t d = 0; d < gridded_; ++d) {
        boxes_[d] = boxes;
        if (points.angle()[d]) {
            origin_[d] = -0.5;
            size_[d] = 1.0 / static_cast<double>(boxes);
            continue;
        }
        double lowest = std::numeric_limits<double>::infinity(), highest = -lowest;
        for (std::size_t i = 0; i < points.size(); ++i)
            if (points.has_image(i)) {
                lowest = std::min(lowest, points.point(i)[d]);
                highest = std::max(highest, points.point(i)[d]);
            }
        const double range = highest - lowest;
        origin_[d] = range >= 0.0 ? lowest : 0.0;
        size_[d] = range > 0.0 ? range / static_cast<double>(boxes) : 1.0;
    }

    std::vector<std::uint32_t> box_of(points.size());
    first_.assign(static_cast<std::size_t>(boxes_[0] * boxes_[1] * boxes_[2]) + 1, 0);
    for (std::size_t i = 0; i < points.size(); ++i) {
        if (!points.has_image(i)) continue;
        std::int64_t box = 0;
        for (std::size_t d = 0; d < gridded_; ++d)
            box = box * boxes_[d] +
                  std::clamp<std::int64_t>(
                      static_cast<std::int64_t>(std::floor((points.point(i)[d] - origin_[d]) / size_[d])), 0,
                      boxes_[d] - 1);
        box_of[i] = static_cast<std::uint32_t>(box);
        ++first_[static_cast<std::size_t>(box) + 1];
    }
    for (std::size_t b = 1; b < first_.size(); ++b)
        first_[b] += first_[b - 1];
    order_.resize(points.image_count());
    sorted_.resize(points.image_count() * n);
    std::vector<std::uint32_t> next(first_.begin(), first_.end() - 1);
    for (std::size_t i = 0; i < points.size(); ++i) {
        if (!points.has_image(i)) continue;
        const std::size_t slot = next[box_of[i]]++;
        order_[slot] = static_cast<std::uint32_t>(i);
        std::copy_n(points.point(i), n, sorted_.data() + slot * n);
    }
}

void BoxGrid::collect(const Eigen::VectorXd& place, std::size_t k, bool mirrored, std::vector<Neighbour>& found) const {
    const auto n = static_cast<std::size_t>(points_->dimension());
    std::array<std::int64_t, maximum_gridded> home{0, 0, 0};
    std::array<double, maximum_gridded> below{}, above{};  // from the place to the faces of its own box
    for (std::size_t d = 0; d < gridded_; ++d) {
        const double offset = (place[static_cast<Eigen::Index>(d)] - origin_[d]) / size_[d];
        const double limit = static_cast<double>(boxes_[d] - 1);
        home[d] = static_cast<std::int64_t>(std::clamp(std::floor(offset), 0.0, limit));
        below[d] = (offset - static_cast<double>(home[d])) * size_[d];
        above[d] = size_[d] - below[d];
    }

    // found is a max-heap of the k nearest so far
    const auto visit = [&](std::int64_t box) {
        for (std::uint32_t slot = first_[static_cast<std::size_t>(box)];
             slot < first_[static_cast<std::size_t>(box) + 1]; ++slot) {
            const double* x = sorted_.data() + static_cast<std::size_t>(slot) * n;
            double distance2 = 0.0;
            for (std::size_t d = 0; d < n; ++d) {
                const auto row = static_cast<Eigen::Index>(d);
                const double r = points_->difference(x[d], place[row], row);
                distance2 += r * r;
            }
            const Neighbour candidate{distance2, order_[slot], mirrored};
            if (found.size() < k) {
                found.push_back(candidate);
                std::push_heap(found.begin(), found.end(), nearer);
            } else if (nearer(candidate, found.front())) {
                std::pop_heap(found.begin(), found.end(), nearer);
                found.back() = candidate;
                std::push_heap(found.begin(), found.end(), nearer);
            }
        }
    };

    for (std::int64_t ring = 0;; ++ring) {
        // Offsets of this ring per coordinate; an angle must not meet the same box from both sides.
        std::array<std::int64_t, maximum_gridded> low{0, 0, 0}, high{0, 0, 0};
        bool all_seen = true;
        for (std::size_t d = 0; d < gridded_; ++d) {
            const bool angle = points_->angle()[d] != 0;
            const std::int64_t most_low = angle ? -((boxes_[d] - 1) / 2) : -home[d];
            const std::int64_t most_high = angle ? boxes_[d] / 2 : boxes_[d] - 1 - home[d];
            low[d] = std::max(-ring, most_low);
            high[d] = std::min(ring, most_high);
            if (low[d] > most_low || high[d] < most_high) all_seen = false;
        }
        for (std::int64_t a = low[0]; a <= high[0]; ++a) {
            const std::int64_t row_0 = (home[0] + a + boxes_[0]) % boxes_[0];
            const bool edge_0 = a == -ring || a == ring;
            for (std::int64_t b = low[1]; b <= high[1]; ++b) {
                const std::int64_t row_1 = row_0 * boxes_[1] + (home[1] + b + boxes_[1]) % boxes_[1];
                const bool edge_1 = edge_0 || b == -ring || b == ring;
                for (std::int64_t c = low[2]; c <= high[2]; ++c)
                    if (edge_1 || c == -ring || c == ring)
                        visit(row_1 * boxes_[2] + (home[2] + c + boxes_[2]) % boxes_[2]);
            }
        }
        if (all_seen) return;
        if (found.size() < k) continue;
        // Every point not seen is at least this far away.
        double reach = std::numeric_limits<double>::infinity();
        for (std::size_t d = 0; d < gridded_; ++d) {
            const bool angle = points_->angle()[d] != 0;
            const double grown = static_cast<double>(ring) * size_[d];
            if (angle ? 2 * ring + 1 < boxes_[d] : home[d] - ring > 0) reach = std::min(reach, grown + below[d]);
            if (angle ? 2 * ring + 1 < boxes_[d] : home[d] + ring < boxes_[d] - 1)
                reach = std::min(reach, grown + above[d]);
        }
        if (reach > 0.0 && reach * reach > found.front().distance2) return;
    }
}

std::vector<Neighbour> BoxGrid::nearest(const Eigen::VectorXd& place, std::size_t k) const {
    std::vector<Neighbour> found;
    if (k == 0) return found;
    found.reserve(points_->symmetric() ? 2 * k : k);
    const Eigen::VectorXd home = points_->wrapped(place);
    collect(home, k, false, found);
    if (points_->symmetric()) {
        // Mirrored copies are not stored: |S x - y| = |x - S y|, so the mirrored place is asked instead. The copies
        // join the same heap, so that only boxes near enough are visited.
        collect(points_->wrapped(points_->signs().cwiseProduct(home)), k, true, found);
    }
    std::sort_heap(found.begin(), found.end(), nearer);
    return found;
}

}  // namespace orbid::orbits
