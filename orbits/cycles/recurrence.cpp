#include "orbits/cycles/recurrence.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <unordered_map>
#include <utility>

namespace orbid::orbits {
namespace {

// A group's pieces lie within this many boxes of its leader.
constexpr double group_radius = 2.0;

struct Recurrent {
    double gap;  // largest coordinate of x_{t+p} - x_t
    std::size_t start;
};

double mirrored_difference(const SectionPoints& points, std::size_t a, std::size_t b) {
    double largest = 0.0;
    for (Eigen::Index d = 0; d < points.dimension(); ++d)
        largest = std::max(largest,
                           std::abs(points.difference(points.signs()[d] * points.point(a)[d], points.point(b)[d], d)));
    return largest;
}

// Boxes around the circle: at least the asked size, so that the last box is not a sliver.
std::int64_t boxes_per_turn(double box) {
    return std::max<std::int64_t>(1, static_cast<std::int64_t>(1.0 / box));
}

std::int64_t box_number(const SectionPoints& points, double value, Eigen::Index d, double box) {
    if (!points.is_angle(d)) return static_cast<std::int64_t>(std::floor(value / box));
    const std::int64_t boxes = boxes_per_turn(box);
    return std::clamp<std::int64_t>(static_cast<std::int64_t>(std::floor((value + 0.5) * static_cast<double>(boxes))),
                                    0, boxes - 1);
}

bool own_or_next_box(const SectionPoints& points, std::size_t a, std::size_t b, double box) {
    for (Eigen::Index d = 0; d < points.dimension(); ++d) {
        std::int64_t apart =
            std::abs(box_number(points, points.point(a)[d], d, box) - box_number(points, points.point(b)[d], d, box));
        if (points.is_angle(d)) apart = std::min(apart, boxes_per_turn(box) - apart);
        if (apart > 1) return false;
    }
    return true;
}

std::vector<Recurrent> recurrent_points(const SectionPoints& points, std::size_t period, double box) {
    std::vector<Recurrent> found;
    std::size_t run = 0;  // points before this one, without a break, that have an image
    for (std::size_t i = 0; i < points.size(); ++i) {
        // Here `run` images lead up to point i: it is the end of a piece that began `period` sections ago.
        if (run >= period && own_or_next_box(points, i - period, i, box))
            found.push_back({points.largest_difference(i - period, i), i - period});
        run = points.has_image(i) ? run + 1 : 0;
    }
    return found;
}

/// Where the points of the leaders lie: coarse boxes over at most three coordinates.
class LeaderIndex {
public:
    LeaderIndex(const SectionPoints& points, double edge) : points_(&points), edge_(edge) {
        gridded_ = std::min<Eigen::Index>(points.dimension(), 3);
    }

    void add(std::size_t leader, std::size_t shift, std::size_t point) {
        entries_[key(numbers(points_->point(point), false), {0, 0, 0})].emplace_back(leader, shift);
    }

    /// Calls use(leader, shift) for leaders' points in the own and the neighbouring boxes until it returns true.
    template <class Use>
    void near(std::size_t point, bool mirrored, Use use) const {
        const auto home = numbers(points_->point(point), mirrored);
        const int reach_1 = gridded_ > 1 ? 1 : 0;
        const int reach_2 = gridded_ > 2 ? 1 : 0;
        for (int a = -1; a <= 1; ++a)
            for (int b = -reach_1; b <= reach_1; ++b)
                for (int c = -reach_2; c <= reach_2; ++c) {
                    const auto found = entries_.find(key(home, {a, b, c}));
                    if (found == entries_.end()) continue;
                    for (const auto& entry : found->second)
                        if (use(entry.first, entry.second)) return;
                }
    }

private:
    using Numbers = std::array<std::int64_t, 3>;

    Numbers numbers(const double* x, bool mirrored) const {
        Numbers result{0, 0, 0};
        for (Eigen::Index d = 0; d < gridded_; ++d) {
            double value = mirrored ? points_->signs()[d] * x[d] : x[d];
            if (points_->is_angle(d) && value >= 0.5) value -= 1.0;
            result[static_cast<std::size_t>(d)] = box_number(*points_, value, d, edge_);
        }
        return result;
    }

    std::uint64_t key(Numbers home, const std::array<int, 3>& offset) const {
        std::uint64_t hash = 0;
        for (Eigen::Index d = 0; d < gridded_; ++d) {
            const auto at = static_cast<std::size_t>(d);
            std::int64_t number = home[at] + offset[at];
            if (points_->angle()[at]) {
                const std::int64_t boxes = boxes_per_turn(edge_);
                number = (number + boxes) % boxes;
            }
            // Numbers are small; 21 bits each cannot collide below 2^20 boxes on either side of zero.
            hash = (hash << 21) ^ (static_cast<std::uint64_t>(number + (1 << 20)) & 0x1fffffU);
        }
        return hash;
    }

    const SectionPoints* points_;
    double edge_;
    Eigen::Index gridded_ = 0;
    std::unordered_map<std::uint64_t, std::vector<std::pair<std::size_t, std::size_t>>> entries_;
};

}  // namespace

std::vector<RecurrenceSeed> recurrence_seeds(const SectionPoints& points, int period, double box, std::size_t minimum) {
    const auto p = static_cast<std::size_t>(period);
    std::vector<Recurrent> recurrent = recurrent_points(points, p, box);
    std::sort(recurrent.begin(), recurrent.end(), [](const Recurrent& a, const Recurrent& b) {
        return a.gap != b.gap ? a.gap < b.gap : a.start < b.start;
    });

    const double radius = group_radius * box;
    LeaderIndex index(points, radius);
    std::vector<RecurrenceSeed> seeds;
    for (const Recurrent& candidate : recurrent) {
        points.stop_if_asked();
        bool joined = false;
        for (const bool mirrored : {false, true}) {
            if (joined || (mirrored && !points.symmetric())) continue;
            index.near(candidate.start, mirrored, [&](std::size_t leader, std::size_t shift) {
                for (std::size_t j = 0; j < p; ++j) {
                    const std::size_t own = candidate.start + j;
                    const std::size_t other = seeds[leader].start + (shift + j) % p;
                    const double apart =
                        mirrored ? mirrored_difference(points, own, other) : points.largest_difference(own, other);
                    if (!(apart <= radius)) return false;
                }
                ++seeds[leader].recurrences;
                joined = true;
                return true;
            });
        }
        if (joined) continue;
        for (std::size_t j = 0; j < p; ++j)
            index.add(seeds.size(), j, candidate.start + j);
        seeds.push_back({candidate.start, 1});
    }

    std::erase_if(seeds, [minimum](const RecurrenceSeed& seed) { return seed.recurrences < minimum; });
    std::sort(seeds.begin(), seeds.end(), [](const RecurrenceSeed& a, const RecurrenceSeed& b) {
        return a.recurrences != b.recurrences ? a.recurrences > b.recurrences : a.start < b.start;
    });
    return seeds;
}

}  // namespace orbid::orbits
