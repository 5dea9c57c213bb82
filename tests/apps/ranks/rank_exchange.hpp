#pragma once

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <ctime>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

#include "estimator/ranks/ranks.hpp"

// One exchange of messages that every kind of ranks must pass: lead() in rank 0, follow() in all others.
namespace rank_exchange {

using orbid::estimator::RankMessage;
using orbid::estimator::Ranks;
using Bytes = std::vector<std::byte>;

constexpr std::size_t big_length = 50'000'000;

/// What followers are asked for: the first byte of a message.
enum class Ask : std::uint8_t { echo, big, stop };

inline void require(bool right, const std::string& what) {
    if (!right) throw std::runtime_error("not so: " + what);
}

/// A message to tell from others by its content.
inline Bytes pattern(std::size_t length, int rank) {
    constexpr std::size_t period = 4093;
    Bytes bytes(length);
    std::uint32_t word = 12345u + static_cast<std::uint32_t>(rank);
    for (std::size_t k = 0; k < std::min(period, length); ++k) {
        word = word * 1664525u + 1013904223u;
        bytes[k] = static_cast<std::byte>(word >> 24);
    }
    for (std::size_t k = period; k < length; k += period)
        std::copy_n(bytes.begin(), std::min(period, length - k), bytes.begin() + static_cast<std::ptrdiff_t>(k));
    return bytes;
}

inline Bytes asking(Ask what, std::size_t length = 0) {
    Bytes bytes = pattern(length + 1, static_cast<int>(length));
    bytes[0] = static_cast<std::byte>(what);
    return bytes;
}

/// Answers rank 0 until it asks to stop, or has ended. @return 0, or 1 when a big message is not what it should be
inline int follow(Ranks& ranks) {
    for (;;) {
        RankMessage message = ranks.receive(0);
        if (message.lost) return 0;
        switch (static_cast<Ask>(message.content.at(0))) {
            case Ask::echo:
                ranks.send(0, message.content);
                break;
            case Ask::big: {
                // Rank 0 sends as much at the same time.
                ranks.send(0, pattern(big_length, ranks.rank()));
                if (ranks.receive(0).content != pattern(big_length, 100 + ranks.rank())) return 1;
                ranks.send(0, {});
                break;
            }
            case Ask::stop:
                return 0;
        }
    }
}

inline void lead_echoes(Ranks& ranks) {
    const std::vector<std::size_t> lengths{0, 1, 15, 16, 17, 4095, 70'000, 1'000'000};
    for (int rank = 1; rank < ranks.count(); ++rank)
        for (const std::size_t length : lengths)
            ranks.send(rank, asking(Ask::echo, length));
    // The last first: messages of others wait.
    for (int rank = ranks.count() - 1; rank > 0; --rank)
        for (const std::size_t length : lengths) {
            const RankMessage answer = ranks.receive(rank);
            require(!answer.lost && answer.from == rank, "a message of the rank that was asked for");
            require(answer.content == asking(Ask::echo, length), "an echo, in the order of what was sent");
        }
    constexpr int rounds = 200;
    for (int round = 0; round < rounds; ++round)
        for (int rank = 1; rank < ranks.count(); ++rank)
            ranks.send(rank, asking(Ask::echo, static_cast<std::size_t>(round)));
    std::vector<std::size_t> next(static_cast<std::size_t>(ranks.count()), 0);
    for (int k = 0; k < rounds * (ranks.count() - 1); ++k) {
        const RankMessage answer = ranks.receive(Ranks::any);
        require(answer.content == asking(Ask::echo, next.at(static_cast<std::size_t>(answer.from))++),
                "echoes of any rank, each rank's in order");
    }
}

inline void lead_big_messages(Ranks& ranks) {
    for (int rank = 1; rank < ranks.count(); ++rank) {
        ranks.send(rank, asking(Ask::big));
        ranks.send(rank, pattern(big_length, 100 + rank));
    }
    for (int rank = 1; rank < ranks.count(); ++rank) {
        require(ranks.receive(rank).content == pattern(big_length, rank),
                "a big message while another went the other way");
        require(ranks.receive(rank).content.empty(), "an empty message");
    }
}

/// Nothing comes: that is said when patience has passed, and waiting takes no processor.
inline void lead_waiting(Ranks& ranks) {
    using clock = std::chrono::steady_clock;
    require(!ranks.receive(Ranks::any, std::chrono::milliseconds(0)), "nothing comes at once");
    const auto begun = clock::now();
    const std::clock_t used = std::clock();
    require(!ranks.receive(Ranks::any, std::chrono::milliseconds(500)), "nothing comes");
    const double seconds = std::chrono::duration<double>(clock::now() - begun).count();
    const double processor = static_cast<double>(std::clock() - used) / CLOCKS_PER_SEC;
    require(seconds >= 0.499, "patience of 0.5 s, not of " + std::to_string(seconds) + " s");
    // Waiting at full speed takes 0.5 s, questions once a millisecond 0.01 s to 0.03 s.
    require(processor < 0.2, "waiting takes " + std::to_string(processor) + " s of the processor");
}

inline void lead_stop(Ranks& ranks) {
    for (int rank = 1; rank < ranks.count(); ++rank)
        ranks.send(rank, asking(Ask::stop));
    std::vector<bool> lost(static_cast<std::size_t>(ranks.count()));
    for (int rank = 1; rank < ranks.count(); ++rank) {
        const RankMessage message = ranks.receive(Ranks::any);
        require(message.lost && message.content.empty(), "the end of a rank");
        require(!lost.at(static_cast<std::size_t>(message.from)), "the end of each rank once");
        lost.at(static_cast<std::size_t>(message.from)) = true;
        ranks.send(message.from, asking(Ask::echo));
    }
    require(!ranks.receive(Ranks::any, std::chrono::milliseconds(20)), "nothing comes after all have ended");
}

/// @throws std::runtime_error naming what was not as it should be.
inline void lead(Ranks& ranks) {
    require(ranks.rank() == 0, "rank 0 leads");
    const Bytes own = pattern(1000, 0);
    ranks.send(0, own);
    require(ranks.receive(0).content == own, "a message to itself");
    lead_echoes(ranks);
    lead_big_messages(ranks);
    lead_waiting(ranks);
    lead_stop(ranks);
}

}  // namespace rank_exchange
