#pragma once

#include <exception>
#include <functional>
#include <latch>
#include <thread>
#include <vector>

namespace orbid::tests {

/// work(0), ..., work(count - 1) by a thread each, which begin at the same time; the results in this order. The first
/// exception is thrown here.
template <class Result>
std::vector<Result> at_once(std::size_t count, const std::function<Result(std::size_t)>& work) {
    std::vector<Result> results(count);
    std::vector<std::exception_ptr> failures(count);
    std::latch start(static_cast<std::ptrdiff_t>(count));
    std::vector<std::thread> threads;
    for (std::size_t k = 0; k < count; ++k)
        threads.emplace_back([&, k] {
            start.arrive_and_wait();
            try {
                results[k] = work(k);
            } catch (...) {  // of whatever kind: the test is to end with it, not the program
                failures[k] = std::current_exception();
            }
        });
    for (std::thread& thread : threads)
        thread.join();
    for (const std::exception_ptr& failure : failures)
        if (failure) std::rethrow_exception(failure);
    return results;
}

}  // namespace orbid::tests
