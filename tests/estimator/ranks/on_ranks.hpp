#pragma once

#include <cstddef>
#include <exception>
#include <thread>
#include <vector>

#include "estimator/ranks/thread_ranks.hpp"

namespace orbid::tests {

/// Calls work(ranks) on so many threads as ranks. What one of them throws is thrown here: that of the rank that was
/// first to end so, for others may then have failed because of it.
template <class Work>
void on_ranks(int count, const Work& work) {
    estimator::ThreadRanks ranks(count);
    std::mutex mutex;
    std::exception_ptr first;
    std::vector<std::thread> threads;
    for (int rank = 0; rank < count; ++rank)
        threads.emplace_back([&, rank] {
            try {
                work(ranks[rank]);
            } catch (...) {
                const std::lock_guard lock(mutex);
                if (!first) first = std::current_exception();
            }
            ranks.end(rank);
        });
    for (std::thread& thread : threads)
        thread.join();
    if (first) std::rethrow_exception(first);
}

}  // namespace orbid::tests
