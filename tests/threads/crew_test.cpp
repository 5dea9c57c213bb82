// The loops by plain threads that stand in for oneTBB under the thread sanitizer: every index once, few threads, no
// deadlock, exceptions in the caller.

#include <algorithm>
#include <atomic>
#include <numeric>
#include <stdexcept>
#include <thread>
#include <vector>

#include <oneapi/tbb/global_control.h>
#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/task_arena.h>
#include <tbb/concurrent_unordered_map.h>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_invoke.h>
#include <tbb/parallel_sort.h>

#include "tests/catch.hpp"

namespace {

/// Threads that are inside at the same time, and the most there ever were.
struct Inside {
    std::atomic<int> now{0}, most{0};
    void visit() {
        const int here = ++now;
        for (int seen = most; seen < here && !most.compare_exchange_weak(seen, here);) {
        }
        std::this_thread::yield();
        --now;
    }
};

}  // namespace

TEST_CASE("loops by plain threads visit every index once", "[threads][crew]") {
    std::vector<int> visits(1000, 0);
    tbb::parallel_for(std::size_t{0}, visits.size(), [&](std::size_t i) { ++visits[i]; });
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, visits.size(), 7), [&](const auto& range) {
        for (std::size_t i = range.begin(); i < range.end(); ++i)
            ++visits[i];
    });
    tbb::parallel_for(5, 5, [&](int) { visits[0] = 0; });
    CHECK(std::all_of(visits.begin(), visits.end(), [](int count) { return count == 2; }));

    bool first = false, second = false;
    tbb::parallel_invoke([&] { first = true; }, [&] { second = true; });
    CHECK((first && second));

    std::vector<int> mixed(5000), sorted(5000);
    std::iota(sorted.begin(), sorted.end(), 0);
    for (std::size_t i = 0; i < mixed.size(); ++i)
        mixed[i * 1237 % mixed.size()] = static_cast<int>(i);  // 1237 and 5000 have no common divisor
    tbb::parallel_sort(mixed.begin(), mixed.end());
    CHECK(mixed == sorted);

    tbb::enumerable_thread_specific<int> parts(0);
    tbb::concurrent_unordered_map<int, int> squares;
    tbb::parallel_for(0, 100, [&](int i) {
        parts.local() += i;
        squares.emplace(i % 10, i % 10 * (i % 10));
    });
    int sum = 0;
    for (const int part : parts)
        sum += part;
    CHECK(sum == 4950);
    CHECK(squares.find(7)->second == 49);
    CHECK(squares.find(10) == squares.end());
}

TEST_CASE("loops within loops by plain threads have few threads", "[threads][crew]") {
    Inside all;
    tbb::parallel_for(0, 30, [&](int) { tbb::parallel_for(0, 30, [&](int) { all.visit(); }); });
    CHECK(all.most <= tbb::detail::Limits::most_others + 1);

    Inside few;
    tbb::task_arena arena(2);
    arena.execute([&] {
        CHECK(tbb::this_task_arena::max_concurrency() == 2);
        tbb::parallel_for(0, 30, [&](int) { tbb::parallel_for(0, 30, [&](int) { few.visit(); }); });
    });
    CHECK(few.most <= 2);

    Inside one;
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, 1);
    tbb::parallel_for(0, 100, [&](int) { one.visit(); });
    CHECK(one.most == 1);
}

TEST_CASE("an exception in a loop by plain threads is the caller's", "[threads][crew]") {
    std::atomic<int> visits{0};
    CHECK_THROWS_WITH(tbb::parallel_for(0, 1000000,
                                        [&](int i) {
                                            ++visits;
                                            if (i == 3) throw std::runtime_error("the fourth");
                                        }),
                      "the fourth");
    CHECK(visits < 1000000);
}

// Run by a test that passes when the sanitizer reports it: two indices of a loop that add to one number, which the
// order they happen to run in must not hide.
TEST_CASE("a race between two indices of a loop", "[.][race]") {
    int sum = 0;
    tbb::parallel_for(0, 1000, [&](int i) { sum += i; });
    CHECK(sum <= 499500);
}
