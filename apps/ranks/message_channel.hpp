#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <span>
#include <utility>
#include <vector>

namespace orbid::apps {

/// One end of a stream socket between two processes that carries whole messages. No call blocks: what the other side
/// does not take yet is queued.
class MessageChannel {
public:
    /// What a message is: one between ranks, or the text of the exception that a process ended with.
    enum class Kind : std::uint32_t { message, failure };
    struct Message {
        Kind kind = Kind::message;
        std::vector<std::byte> content;
    };

    /// Closed from the start.
    MessageChannel() = default;
    MessageChannel(MessageChannel&& other) noexcept { swap(other); }
    MessageChannel& operator=(MessageChannel&& other) noexcept {
        swap(other);
        return *this;
    }
    ~MessageChannel() { close(); }

    /// The two ends of a new socket; programs that either process starts do not inherit them.
    /// @throws std::system_error when there can be no more sockets.
    [[nodiscard]] static std::pair<MessageChannel, MessageChannel> connected();

    /// Puts a message at the end of what write() sends. Once the other side has closed: nothing.
    void queue(Kind kind, std::span<const std::byte> content);
    /// Sends as much of the queue as the other side takes.
    void write();
    /// Reads what is there, up to a few megabytes. @return the messages that are whole now
    [[nodiscard]] std::vector<Message> read();
    void close();

    [[nodiscard]] int socket() const { return socket_; }
    /// Something is queued.
    [[nodiscard]] bool unsent() const { return !queue_.empty(); }
    /// The other side has closed, and all it sent has been read. A message that it left unfinished is lost.
    [[nodiscard]] bool ended() const { return ended_; }

private:
    /// Stands before each message; both ends are one program on one machine.
    struct Header {
        std::uint64_t length = 0;
        Kind kind = Kind::message;
        std::uint32_t unused = 0;
    };

    void swap(MessageChannel& other) noexcept;

    int socket_ = -1;
    bool ended_ = false;
    bool taken_ = true;                         ///< the other side still takes something
    std::deque<std::vector<std::byte>> queue_;  ///< each with its header
    std::size_t sent_ = 0;                      ///< bytes of the first in the queue
    Header header_;                             ///< of the message that is being read
    std::size_t read_ = 0;                      ///< bytes of header and content that have been read
    std::vector<std::byte> content_;
};

}  // namespace orbid::apps
