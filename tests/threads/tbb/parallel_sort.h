#pragma once

#include <algorithm>
#include <iterator>

#include "parallel_invoke.h"

namespace tbb {

/// Halves by themselves, then merged; short ones by one thread.
template <class Iterator>
void parallel_sort(Iterator begin, Iterator end) {
    constexpr std::ptrdiff_t short_one = 1024;
    if (end - begin <= short_one) {
        std::sort(begin, end);
        return;
    }
    const Iterator middle = begin + (end - begin) / 2;
    parallel_invoke([&] { parallel_sort(begin, middle); }, [&] { parallel_sort(middle, end); });
    std::inplace_merge(begin, middle, end);
}

}  // namespace tbb
