#include "apps/ranks/forked_rank.hpp"

#include <poll.h>

#include <exception>
#include <stdexcept>
#include <string_view>
#include <utility>

#include <fmt/format.h>

#include "apps/ranks/waiting.hpp"

namespace orbid::apps {

using estimator::RankMessage;

void ForkedRank::send(int to, std::span<const std::byte> content) {
    if (to == rank_) {
        inbox_.put({rank_, {content.begin(), content.end()}, false});
    } else if (to == 0) {
        send(MessageChannel::Kind::message, content);
    } else {
        throw std::logic_error(
            fmt::format("rank {} sends to rank {}: processes exchange messages with rank 0 alone", rank_, to));
    }
}

void ForkedRank::send(MessageChannel::Kind kind, std::span<const std::byte> content) {
    leader_.queue(kind, content);
    leader_.write();
    while (leader_.unsent() && !lost_)
        exchange(-1);
}

std::optional<RankMessage> ForkedRank::receive(int from, std::chrono::milliseconds patience) {
    const Waiting waiting(patience);
    for (;;) {
        if (auto message = inbox_.take(from)) return message;
        const int left = waiting.left();
        exchange(left);
        if (left == 0) return inbox_.take(from);
    }
}

void ForkedRank::exchange(int patience_ms) {
    pollfd ready{leader_.socket(), static_cast<short>(leader_.unsent() ? POLLIN | POLLOUT : POLLIN), 0};
    // After the end of rank 0 there is nothing to wait for but the time.
    if (::poll(&ready, lost_ ? 0 : 1, patience_ms) <= 0) return;
    if ((ready.revents & POLLOUT) != 0) leader_.write();
    for (MessageChannel::Message& message : leader_.read())
        inbox_.put({0, std::move(message.content), false});
    if (!leader_.ended()) return;
    lost_ = true;
    inbox_.put({0, {}, true});
}

int ForkedRank::run(const std::function<int(Ranks&)>& child) {
    std::string_view text;
    try {
        return child(*this);
    } catch (const std::exception& error) {
        text = error.what();
        send(MessageChannel::Kind::failure, std::as_bytes(std::span(text.data(), text.size())));
    } catch (...) {
        text = "unknown";
        send(MessageChannel::Kind::failure, std::as_bytes(std::span(text.data(), text.size())));
    }
    return 1;
}

}  // namespace orbid::apps
