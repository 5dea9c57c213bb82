#pragma once

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <exception>
#include <mutex>
#include <set>
#include <thread>
#include <vector>

// Under the thread sanitizer alone: the part of oneTBB that orbid uses, of plain threads. Debian's libtbb is not
// instrumented, so that the sanitizer does not see what its loops wait for and would report every one of them.
//
// Each loop starts threads of its own and joins them, and what they share meanwhile are relaxed counters: two pieces of
// a loop are then ordered by nothing but what our code does, and a race between them is reported even when they
// happened to run one after the other. A pool, or counters that synchronise, would hide those.

namespace tbb {

namespace detail {

/// Threads that a loop may have where nothing says otherwise: more than one also on a machine of one core.
inline int default_concurrency() {
    return std::max(4, static_cast<int>(std::thread::hardware_concurrency()));
}

/// How many threads may work for one task_arena, and how many beside its caller do.
struct Arena {
    int limit = default_concurrency();
    std::atomic<int> others{0};
};

/// Limits by global_control, and threads of all loops: loops within loops, called by many threads, stay few.
class Limits {
public:
    static constexpr int most_others = 12;

    static Limits& all() {
        static Limits limits;
        return limits;
    }
    void add(std::size_t limit) {
        const std::lock_guard lock(mutex_);
        limits_.insert(limit);
        store();
    }
    void remove(std::size_t limit) {
        const std::lock_guard lock(mutex_);
        limits_.erase(limits_.find(limit));
        store();
    }
    [[nodiscard]] int limit() const { return limit_.load(std::memory_order_relaxed); }

    /// Asks for up to `wanted` threads; fewer, or none, are granted.
    int take(Arena& arena, int wanted) {
        wanted = std::min(wanted, std::min(arena.limit, limit()) - 1);
        int granted = 0;
        while (granted < wanted) {
            if (others_.fetch_add(1, std::memory_order_relaxed) >= most_others) {
                others_.fetch_sub(1, std::memory_order_relaxed);
                break;
            }
            if (arena.others.fetch_add(1, std::memory_order_relaxed) >= std::min(arena.limit, limit()) - 1) {
                arena.others.fetch_sub(1, std::memory_order_relaxed);
                others_.fetch_sub(1, std::memory_order_relaxed);
                break;
            }
            ++granted;
        }
        return granted;
    }
    void give_back(Arena& arena, int granted) {
        arena.others.fetch_sub(granted, std::memory_order_relaxed);
        others_.fetch_sub(granted, std::memory_order_relaxed);
    }

private:
    void store() {
        limit_.store(limits_.empty() ? default_concurrency() : static_cast<int>(*limits_.begin()),
                     std::memory_order_relaxed);
    }

    std::mutex mutex_;
    std::multiset<std::size_t> limits_;
    std::atomic<int> limit_{default_concurrency()};
    std::atomic<int> others_{0};
};

/// The arena that loops of this thread belong to: one of its own unless a task_arena is being executed.
inline Arena*& current_arena() {
    thread_local Arena own;
    thread_local Arena* current = &own;
    return current;
}

/// work(i) for every i < count, by this thread and as many as are granted: of T threads the t-th has the indices t,
/// t + T, ... Were they dealt out on demand, the first thread would often do all of a short loop, and nothing be seen.
/// The first exception ends the loop and is thrown here.
template <class Work>
void each(std::size_t count, const Work& work) {
    if (count == 0) return;
    Arena& arena = *current_arena();
    const int others =
        Limits::all().take(arena, static_cast<int>(std::min<std::size_t>(count - 1, Limits::most_others)));
    const std::size_t all = static_cast<std::size_t>(others) + 1;
    std::atomic<bool> failed{false};
    std::mutex door;
    std::exception_ptr failure;
    const auto share = [&](std::size_t first) {
        for (std::size_t i = first; i < count && !failed.load(std::memory_order_relaxed); i += all) {
            try {
                work(i);
            } catch (...) {  // whatever it is, it goes on in the thread that asked for the loop
                const std::lock_guard lock(door);
                if (!failure) failure = std::current_exception();
                failed.store(true, std::memory_order_relaxed);
            }
        }
    };
    std::vector<std::thread> threads;
    threads.reserve(static_cast<std::size_t>(others));
    for (std::size_t t = 1; t < all; ++t)
        threads.emplace_back([&, t] {
            current_arena() = &arena;
            share(t);
        });
    share(0);
    for (std::thread& thread : threads)
        thread.join();
    Limits::all().give_back(arena, others);
    if (failure) std::rethrow_exception(failure);
}

}  // namespace detail

}  // namespace tbb

namespace oneapi {
namespace tbb = ::tbb;
}
