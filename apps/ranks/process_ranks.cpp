#include "apps/ranks/process_ranks.hpp"

#include <poll.h>

#include <stdexcept>
#include <utility>

#include <fmt/format.h>

#include "apps/ranks/forked_rank.hpp"
#include "apps/ranks/waiting.hpp"

namespace orbid::apps {

using estimator::RankMessage;

ProcessRanks::ProcessRanks(int count, Child child) : child_(std::move(child)) {
    if (count < 1) throw std::invalid_argument(fmt::format("ProcessRanks: count must be >= 1, not {}", count));
    others_.resize(static_cast<std::size_t>(count) - 1);
    for (int rank = 1; rank < count; ++rank)
        start(rank);
}

ProcessRanks::~ProcessRanks() {
    // All at once: a large process takes a while to end.
    for (const Other& each : others_)
        each.process.kill();
}

std::size_t ProcessRanks::index(int rank) const {
    if (rank < 1 || rank >= count())
        throw std::out_of_range(fmt::format("ProcessRanks: there is no process of rank {} among {}", rank, count()));
    return static_cast<std::size_t>(rank) - 1;
}

void ProcessRanks::start(int rank) {
    auto ends = MessageChannel::connected();
    MessageChannel &here = ends.first, &there = ends.second;
    ChildProcess process([&] {
        // Who holds rank 0's end of another process would keep that one waiting when rank 0 is gone.
        here.close();
        for (Other& each : others_)
            each.channel.close();
        return ForkedRank(rank, count(), std::move(there)).run(child_);
    });
    other(rank) = Other{std::move(process), std::move(here), {}, {}, false};
}

void ProcessRanks::send(int to, std::span<const std::byte> content) {
    if (to == 0) {
        inbox_.put({0, {content.begin(), content.end()}, false});
        return;
    }
    MessageChannel& channel = other(to).channel;
    channel.queue(MessageChannel::Kind::message, content);
    channel.write();
}

std::optional<RankMessage> ProcessRanks::receive(int from, std::chrono::milliseconds patience) {
    for (Other& each : others_)
        each.channel.write();
    const Waiting waiting(patience);
    for (bool last = false;;) {
        if (auto message = inbox_.take(from)) {
            if (message->lost) other(message->from).told = true;
            return message;
        }
        if (last) return std::nullopt;
        const int left = waiting.left();
        last = left == 0;
        exchange(left);
    }
}

void ProcessRanks::exchange(int patience_ms) {
    std::vector<pollfd> ready;
    std::vector<int> ranks;
    for (int rank = 1; rank < count(); ++rank) {
        const Other& each = other(rank);
        if (!each.process) continue;
        ready.push_back(
            {each.channel.socket(), static_cast<short>(each.channel.unsent() ? POLLIN | POLLOUT : POLLIN), 0});
        ranks.push_back(rank);
    }
    // A signal ends the wait early; the caller waits on.
    if (::poll(ready.data(), ready.size(), patience_ms) <= 0) return;
    for (std::size_t k = 0; k < ready.size(); ++k) {
        if ((ready[k].revents & POLLOUT) != 0) other(ranks[k]).channel.write();
        if ((ready[k].revents & ~POLLOUT) != 0) read(ranks[k]);
    }
}

void ProcessRanks::read(int rank) {
    Other& from = other(rank);
    for (MessageChannel::Message& message : from.channel.read()) {
        if (message.kind == MessageChannel::Kind::failure)
            from.failure.assign(reinterpret_cast<const char*>(message.content.data()), message.content.size());
        else
            inbox_.put({rank, std::move(message.content), false});
    }
    if (!from.channel.ended()) return;
    from.channel.close();
    // Its socket closes when it ends, or begins to.
    from.ended = from.process.wait();
    if (!from.failure.empty()) from.ended = "exception: " + from.failure;
    inbox_.put({rank, {}, true});
}

void ProcessRanks::kill(int rank) {
    other(rank).process.kill();
}

void ProcessRanks::restart(int rank) {
    if (!other(rank).told)
        throw std::logic_error(fmt::format("ProcessRanks: rank {} is restarted before its loss was received", rank));
    start(rank);
}

}  // namespace orbid::apps
