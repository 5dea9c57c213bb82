#pragma once

#include "blocked_range.h"
#include "crew.h"
#include "partitioner.h"

namespace tbb {

template <class Index, class Work>
void parallel_for(Index first, Index last, const Work& work) {
    if (!(first < last)) return;
    detail::each(static_cast<std::size_t>(last - first), [&](std::size_t i) { work(first + static_cast<Index>(i)); });
}

template <class Index, class Work>
void parallel_for(Index first, Index last, const Work& work, const simple_partitioner& /*pieces*/) {
    parallel_for(first, last, work);
}

/// Four pieces per thread, none smaller than the grain: about those that the automatic partitioner of oneTBB makes.
template <class Value, class Work>
void parallel_for(const blocked_range<Value>& range, const Work& work) {
    const std::size_t pieces = 4 * static_cast<std::size_t>(detail::default_concurrency());
    const std::size_t size = std::max(range.grainsize(), (range.size() + pieces - 1) / pieces);
    detail::each((range.size() + size - 1) / size, [&](std::size_t i) {
        const std::size_t first = i * size, last = std::min(first + size, range.size());
        work(blocked_range<Value>(range.begin() + static_cast<Value>(first), range.begin() + static_cast<Value>(last),
                                  range.grainsize()));
    });
}

}  // namespace tbb
