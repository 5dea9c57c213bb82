#pragma once

#include <functional>

#include "apps/ranks/message_channel.hpp"
#include "estimator/ranks/rank_inbox.hpp"
#include "estimator/ranks/ranks.hpp"

namespace orbid::apps {

/// A rank that ProcessRanks has forked, in its own process: it exchanges messages with rank 0.
class ForkedRank final : public estimator::Ranks {
public:
    ForkedRank(int rank, int count, MessageChannel leader) : rank_(rank), count_(count), leader_(std::move(leader)) {}

    using Ranks::receive;
    [[nodiscard]] int rank() const override { return rank_; }
    [[nodiscard]] int count() const override { return count_; }
    void send(int to, std::span<const std::byte> content) override;
    [[nodiscard]] std::optional<estimator::RankMessage> receive(int from, std::chrono::milliseconds patience) override;

    /// Runs what a process is for. @return its exit status: 1 after an exception, whose text rank 0 is told
    [[nodiscard]] int run(const std::function<int(estimator::Ranks&)>& child);

private:
    void send(MessageChannel::Kind kind, std::span<const std::byte> content);
    void exchange(int patience_ms);

    int rank_;
    int count_;
    MessageChannel leader_;
    bool lost_ = false;  ///< that rank 0 has ended is in the inbox, or has been told
    estimator::RankInbox inbox_;
};

}  // namespace orbid::apps
