#include "estimator/ranks/thread_ranks.hpp"

#include <stdexcept>
#include <string>
#include <utility>

namespace orbid::estimator {

class ThreadRanks::OneRank final : public Ranks {
public:
    OneRank(ThreadRanks& all, int rank) : all_(all), rank_(rank) {}
    using Ranks::receive;

    [[nodiscard]] int rank() const override { return rank_; }
    [[nodiscard]] int count() const override { return static_cast<int>(all_.inboxes_.size()); }
    void send(int to, std::span<const std::byte> content) override {
        all_.put(to, {rank_, {content.begin(), content.end()}, false});
    }
    [[nodiscard]] std::optional<RankMessage> receive(int from, std::chrono::milliseconds patience) override {
        Inbox& inbox = *all_.inboxes_[static_cast<std::size_t>(rank_)];
        std::unique_lock lock(inbox.mutex);
        std::optional<RankMessage> message;
        inbox.arrived.wait_for(lock, patience, [&] { return (message = inbox.messages.take(from)).has_value(); });
        return message;
    }

private:
    ThreadRanks& all_;
    int rank_;
};

ThreadRanks::ThreadRanks(int count) {
    if (count < 1) throw std::invalid_argument("ThreadRanks: count must be >= 1, not " + std::to_string(count));
    for (int rank = 0; rank < count; ++rank) {
        inboxes_.push_back(std::make_unique<Inbox>());
        ranks_.push_back(std::make_unique<OneRank>(*this, rank));
    }
}

ThreadRanks::~ThreadRanks() = default;

void ThreadRanks::end(int rank) {
    for (int other = 0; other < static_cast<int>(inboxes_.size()); ++other)
        if (other != rank) put(other, {rank, {}, true});
}

void ThreadRanks::put(int to, RankMessage message) {
    Inbox& inbox = *inboxes_[static_cast<std::size_t>(to)];
    {
        const std::lock_guard lock(inbox.mutex);
        inbox.messages.put(std::move(message));
    }
    inbox.arrived.notify_all();
}

}  // namespace orbid::estimator
