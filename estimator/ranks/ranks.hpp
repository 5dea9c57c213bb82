#pragma once

#include <chrono>
#include <cstddef>
#include <optional>
#include <span>
#include <vector>

namespace orbid::estimator {

/// What one rank sent to another.
struct RankMessage {
    int from = 0;
    std::vector<std::byte> content;
    bool lost = false;  ///< the sender has ended and will send nothing more; content is empty
};

/// One of several computations that share no memory and exchange messages. Messages from one rank to another arrive
/// whole and in the order they were sent. An object belongs to one thread.
class Ranks {
public:
    static constexpr int any = -1;

    Ranks() = default;
    Ranks(const Ranks&) = delete;
    Ranks& operator=(const Ranks&) = delete;
    virtual ~Ranks() = default;

    /// This rank, 0 to count() - 1; 0 leads.
    [[nodiscard]] virtual int rank() const = 0;
    [[nodiscard]] virtual int count() const = 0;
    /// Sends a message; it may return before the message has arrived. To a rank that has ended: nothing.
    virtual void send(int to, std::span<const std::byte> content) = 0;
    /// The next message of a rank, or of any; nothing when `patience` has passed. That a rank has ended is told once,
    /// by a message that is lost.
    [[nodiscard]] virtual std::optional<RankMessage> receive(int from, std::chrono::milliseconds patience) = 0;
    /// The next message of a rank, or of any, however long it takes.
    [[nodiscard]] RankMessage receive(int from);
};

}  // namespace orbid::estimator
