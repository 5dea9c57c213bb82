#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <utility>

namespace orbid::orbits {

/// Records of n + 1 numbers in a row; n = 0: known at run time only.
template <int n>
struct PointRecords {
    std::uint32_t* data;
    std::size_t stride;  // n + 1

    [[nodiscard]] std::size_t width() const { return n > 0 ? static_cast<std::size_t>(n) + 1 : stride; }
    [[nodiscard]] std::uint32_t* at(std::size_t i) const { return data + i * width(); }
    [[nodiscard]] std::uint32_t key(std::size_t i, std::size_t axis) const { return at(i)[axis]; }
    void swap(std::size_t i, std::size_t j) const {
        std::uint32_t* a = at(i);
        std::uint32_t* b = at(j);
        for (std::size_t c = 0; c < width(); ++c)
            std::swap(a[c], b[c]);
    }
};

/// Floyd and Rivest's selection: afterwards no record of [left, middle) is above, none of (middle, right] below the one
/// at `middle`. About 1.5 comparisons per record: the pivot comes from a sample in which the answer's place is known.
template <int n>
void select_record(const PointRecords<n>& records, std::size_t axis, std::ptrdiff_t left, std::ptrdiff_t right,
                   std::ptrdiff_t middle) {
    const auto key = [&](std::ptrdiff_t i) { return records.key(static_cast<std::size_t>(i), axis); };
    const auto swap = [&](std::ptrdiff_t i, std::ptrdiff_t j) {
        records.swap(static_cast<std::size_t>(i), static_cast<std::size_t>(j));
    };
    while (right > left) {
        if (right - left > 600) {  // sample sizes of the authors' algorithm 489
            const auto size = static_cast<double>(right - left + 1);
            const auto place = static_cast<double>(middle - left + 1);
            const double z = std::log(size);
            const double s = 0.5 * std::exp(2.0 * z / 3.0);
            const double spread = 0.5 * std::sqrt(z * s * (size - s) / size) * (place < 0.5 * size ? -1.0 : 1.0);
            const auto from = static_cast<std::ptrdiff_t>(static_cast<double>(middle) - place * s / size + spread);
            const auto to =
                static_cast<std::ptrdiff_t>(static_cast<double>(middle) + (size - place) * s / size + spread);
            select_record(records, axis, std::max(left, from), std::min(right, to), middle);
        }
        const std::uint32_t pivot = key(middle);
        std::ptrdiff_t i = left, j = right;
        swap(left, middle);
        if (key(right) > pivot) swap(left, right);
        while (i < j) {
            swap(i++, j--);
            while (key(i) < pivot)
                ++i;
            while (key(j) > pivot)
                --j;
        }
        if (key(left) == pivot)
            swap(left, j);
        else
            swap(++j, right);
        if (j <= middle) left = j + 1;
        if (middle <= j) right = j - 1;
    }
}

}  // namespace orbid::orbits
