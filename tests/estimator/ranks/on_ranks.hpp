#pragma once

#include <chrono>
#include <cstddef>
#include <exception>
#include <mutex>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "estimator/ranks/thread_ranks.hpp"

namespace orbid::tests {

/// Ranks of which the others exchange messages with rank 0 alone, as processes do.
class StarRanks : public estimator::Ranks {
public:
    explicit StarRanks(estimator::Ranks& all) : all_(all) {}
    using Ranks::receive;
    [[nodiscard]] int rank() const override { return all_.rank(); }
    [[nodiscard]] int count() const override { return all_.count(); }
    void send(int to, std::span<const std::byte> content) override {
        if (rank() != 0 && to != 0) throw std::logic_error("only rank 0 sends to rank " + std::to_string(to));
        all_.send(to, content);
    }
    [[nodiscard]] std::optional<estimator::RankMessage> receive(int from, std::chrono::milliseconds patience) override {
        if (rank() != 0 && from != 0) throw std::logic_error("only rank 0 receives of rank " + std::to_string(from));
        return all_.receive(from, patience);
    }

private:
    estimator::Ranks& all_;
};

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
                StarRanks star(ranks[rank]);
                work(star);
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
