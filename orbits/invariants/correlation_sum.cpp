#include "orbits/invariants/correlation_sum.hpp"

#include <algorithm>
#include <cmath>

#include <tbb/parallel_for.h>

namespace orbid::orbits {
namespace {

constexpr std::size_t gridded_most = 3;  // coordinates that the boxes divide

using Box = std::array<std::int64_t, gridded_most>;

// Points sorted by box, with the rows of boxes found by binary search: memory follows the points, not the boxes.
class Boxes {
public:
    Boxes(const SectionPoints& points, const std::vector<std::uint32_t>& chosen, double radius)
        : points_(&points),
          gridded_(std::min<std::size_t>(gridded_most, static_cast<std::size_t>(points.dimension()))) {
        for (std::size_t d = 0; d < gridded_; ++d)
            turn_[d] = points.angle()[d] ? static_cast<std::int64_t>(std::floor(1.0 / radius)) : 0;
        edge_ = radius;
        entries_.reserve(chosen.size());
        for (std::size_t c = 0; c < chosen.size(); ++c)
            entries_.push_back({box_of(chosen[c]), static_cast<std::uint32_t>(c)});
        std::sort(entries_.begin(), entries_.end(),
                  [](const Entry& a, const Entry& b) { return a.box != b.box ? a.box < b.box : a.place < b.place; });
    }

    // Visits the places in the list of all points whose box is that of point i or next to it.
    template <class Visit>
    void visit(std::uint32_t i, const Visit& visit) const {
        const Box home = box_of(i);
        // All coordinates but the last by offsets, the last as a run of up to three boxes.
        const std::size_t last = gridded_ - 1;
        Box box = home;
        const auto run = [&](std::int64_t low, std::int64_t high) {
            box[last] = low;
            auto entry = std::lower_bound(entries_.begin(), entries_.end(), box,
                                          [](const Entry& e, const Box& b) { return e.box < b; });
            Box end = box;
            end[last] = high;
            for (; entry != entries_.end() && entry->box <= end; ++entry)
                visit(entry->place);
        };
        const auto rows = [&] {
            const std::int64_t around = turn_[last];
            if (around == 0) return run(home[last] - 1, home[last] + 1);
            if (around <= 3) return run(0, around - 1);
            for (std::int64_t offset = -1; offset <= 1; ++offset) {
                const std::int64_t at = (home[last] + offset + around) % around;
                run(at, at);
            }
        };
        const auto offsets = [&](std::size_t d) {
            std::array<std::int64_t, 3> places{home[d] - 1, home[d], home[d] + 1};
            std::size_t count = 3;
            if (turn_[d] > 0) {
                for (std::int64_t& place : places)
                    place = (place + turn_[d]) % turn_[d];
                std::sort(places.begin(), places.end());
                count = static_cast<std::size_t>(std::unique(places.begin(), places.end()) - places.begin());
            }
            return std::pair{places, count};
        };
        const auto descend = [&](const auto& self, std::size_t d) -> void {
            if (d == last) return rows();
            const auto [places, count] = offsets(d);
            for (std::size_t a = 0; a < count; ++a) {
                box[d] = places[a];
                self(self, d + 1);
            }
        };
        descend(descend, 0);
    }

    // The place in the list of the point in a slot of the order of boxes.
    [[nodiscard]] std::uint32_t place(std::size_t slot) const { return entries_[slot].place; }

private:
    struct Entry {
        Box box;
        std::uint32_t place;  // in the list of points
    };

    [[nodiscard]] Box box_of(std::uint32_t i) const {
        Box box{0, 0, 0};
        for (std::size_t d = 0; d < gridded_; ++d) {
            const double x = points_->point(i)[d];
            if (turn_[d] > 0)
                box[d] = std::min(turn_[d] - 1,
                                  static_cast<std::int64_t>(std::floor((x + 0.5) * static_cast<double>(turn_[d]))));
            else
                box[d] = static_cast<std::int64_t>(std::floor(x / edge_));
        }
        return box;
    }

    const SectionPoints* points_;
    std::size_t gridded_;
    double edge_ = 0.0;
    std::array<std::int64_t, gridded_most> turn_{};  // boxes in a turn; 0: not an angle
    std::vector<Entry> entries_;
};

// The stretch of the series that a place in the list belongs to.
std::size_t stretch_of(std::size_t place, std::size_t size) {
    return place * OctaveCount::stretches / size;
}

void add(OctaveCount::Pairs& sum, const OctaveCount::Pairs& part, double factor) {
    for (std::size_t k = 0; k < sum.within.size(); ++k)
        sum.within[k] += factor * part.within[k];
    sum.ln_ratio += factor * part.ln_ratio;
    sum.different += factor * part.different;
    for (std::size_t k = 0; k < sum.stay.size(); ++k)
        sum.stay[k] += factor * part.stay[k];
}

}  // namespace

OctaveCount::Pairs OctaveCount::without(std::size_t stretch) const {
    Pairs rest = all;
    add(rest, touching[stretch], -1.0);
    return rest;
}

OctaveCount count_pairs(const SectionPoints& points, const std::vector<std::uint32_t>& chosen, double radius,
                        std::size_t theiler, const std::vector<std::uint8_t>& ahead, std::size_t stride) {
    const Boxes boxes(points, chosen, radius);
    // Fixed parts in the order of boxes (the searches of neighbouring points then meet the same memory, five times
    // faster than in the order of time), so that sums are the same with any number of threads. Pairs apart by the
    // stretches of both ends.
    constexpr std::size_t parts = 64, stretches = OctaveCount::stretches;
    std::vector<std::array<OctaveCount::Pairs, stretches * stretches>> sums(parts);
    const double inner = radius / std::sqrt(2.0), half = radius / 2.0;
    tbb::parallel_for(std::size_t{0}, parts, [&](std::size_t part) {
        for (std::size_t c = part * chosen.size() / parts; c < (part + 1) * chosen.size() / parts; ++c) {
            points.stop_if_asked();
            const std::uint32_t own_place = boxes.place(c), i = chosen[own_place];
            const std::size_t own_row = stretch_of(own_place, chosen.size()) * stretches;
            boxes.visit(i, [&](std::uint32_t place) {
                const std::uint32_t j = chosen[place];
                if (!(j > i + theiler)) return;
                const double apart = points.largest_difference(i, j);
                if (!(apart < radius)) return;
                OctaveCount::Pairs& sum = sums[part][own_row + stretch_of(place, chosen.size())];
                sum.within[0] += 1.0;
                if (apart < inner) sum.within[1] += 1.0;
                if (apart < half) sum.within[2] += 1.0;
                if (apart > 0.0) {
                    sum.ln_ratio += std::log(radius / apart);
                    sum.different += 1.0;
                }
                if (std::min(ahead[i], ahead[j]) < OctaveCount::followed) return;
                for (std::size_t k = 0; k < OctaveCount::followed; ++k) {
                    if (!(points.largest_difference(i + k * stride, j + k * stride) < radius)) break;
                    sum.stay[k] += 1.0;
                }
            });
        }
    });
    OctaveCount result;
    for (const auto& part : sums)
        for (std::size_t first = 0; first < stretches; ++first)
            for (std::size_t second = 0; second < stretches; ++second) {
                const OctaveCount::Pairs& pairs = part[first * stretches + second];
                add(result.all, pairs, 1.0);
                add(result.touching[first], pairs, 1.0);
                if (second != first) add(result.touching[second], pairs, 1.0);
            }
    // Pairs of points far enough apart in time; i < j both in `chosen`.
    std::size_t next = 0;
    for (std::size_t c = 0; c < chosen.size(); ++c) {
        while (next < chosen.size() && chosen[next] <= chosen[c] + theiler)
            ++next;
        result.candidates += static_cast<double>(chosen.size() - next);
    }
    return result;
}

}  // namespace orbid::orbits
