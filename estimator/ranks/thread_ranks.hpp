#pragma once

#include <condition_variable>
#include <memory>
#include <mutex>
#include <vector>

#include "estimator/ranks/rank_inbox.hpp"
#include "estimator/ranks/ranks.hpp"

namespace orbid::estimator {

/// Threads of this process as ranks: each thread uses one of them.
class ThreadRanks {
public:
    /// @throws std::invalid_argument when count < 1.
    explicit ThreadRanks(int count);
    ~ThreadRanks();
    [[nodiscard]] Ranks& operator[](int rank) { return *ranks_[static_cast<std::size_t>(rank)]; }
    /// Says to all others that this rank's thread has ended.
    void end(int rank);

private:
    struct Inbox {
        std::mutex mutex;
        std::condition_variable arrived;
        RankInbox messages;
    };
    class OneRank;

    void put(int to, RankMessage message);

    std::vector<std::unique_ptr<Inbox>> inboxes_;
    std::vector<std::unique_ptr<Ranks>> ranks_;
};

}  // namespace orbid::estimator
