#include "apps/ranks/message_channel.hpp"

#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <system_error>

namespace orbid::apps {
namespace {

// Bytes read from one process before others get their turn.
constexpr std::size_t turn = std::size_t{4} << 20;

bool would_block(int error) {
    return error == EAGAIN || error == EWOULDBLOCK;
}

}  // namespace

std::pair<MessageChannel, MessageChannel> MessageChannel::connected() {
    std::array<int, 2> sockets{};
    if (::socketpair(AF_UNIX, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0, sockets.data()) != 0)
        throw std::system_error(errno, std::generic_category(), "a socket between two processes cannot be made");
    std::pair<MessageChannel, MessageChannel> ends;
    ends.first.socket_ = sockets[0];
    ends.second.socket_ = sockets[1];
    return ends;
}

void MessageChannel::queue(Kind kind, std::span<const std::byte> content) {
    if (socket_ < 0 || !taken_) return;
    const Header header{content.size(), kind, 0};
    std::vector<std::byte> framed(sizeof header + content.size());
    std::memcpy(framed.data(), &header, sizeof header);
    if (!content.empty()) std::memcpy(framed.data() + sizeof header, content.data(), content.size());
    queue_.push_back(std::move(framed));
}

void MessageChannel::write() {
    while (!queue_.empty()) {
        const std::vector<std::byte>& first = queue_.front();
        const ssize_t sent = ::send(socket_, first.data() + sent_, first.size() - sent_, MSG_NOSIGNAL);
        if (sent < 0) {
            if (errno == EINTR) continue;
            if (would_block(errno)) return;
            // Closed on the other side; what it has sent may still be there to read.
            taken_ = false;
            queue_.clear();
            sent_ = 0;
            return;
        }
        sent_ += static_cast<std::size_t>(sent);
        if (sent_ < first.size()) continue;
        queue_.pop_front();
        sent_ = 0;
    }
}

std::vector<MessageChannel::Message> MessageChannel::read() {
    std::vector<Message> whole;
    for (std::size_t total = 0; !ended_ && socket_ >= 0 && total < turn;) {
        const bool in_header = read_ < sizeof header_;
        const std::size_t before = in_header ? 0 : sizeof header_;
        std::byte* const start = in_header ? reinterpret_cast<std::byte*>(&header_) : content_.data();
        const std::size_t length = in_header ? sizeof header_ : content_.size();
        const ssize_t got = ::recv(socket_, start + (read_ - before), length - (read_ - before), 0);
        if (got < 0 && errno == EINTR) continue;
        if (got < 0 && would_block(errno)) break;
        if (got <= 0) {
            // A process that is killed before it has read all leaves an error instead of an end.
            ended_ = true;
            break;
        }
        read_ += static_cast<std::size_t>(got);
        total += static_cast<std::size_t>(got);
        if (in_header && read_ == sizeof header_) content_.resize(header_.length);
        if (read_ < sizeof header_ || read_ < sizeof header_ + content_.size()) continue;
        whole.push_back({header_.kind, std::exchange(content_, {})});
        read_ = 0;
    }
    return whole;
}

void MessageChannel::close() {
    if (socket_ >= 0) ::close(socket_);
    socket_ = -1;
    queue_.clear();
}

void MessageChannel::swap(MessageChannel& other) noexcept {
    std::swap(socket_, other.socket_);
    std::swap(ended_, other.ended_);
    std::swap(taken_, other.taken_);
    queue_.swap(other.queue_);
    std::swap(sent_, other.sent_);
    std::swap(header_, other.header_);
    std::swap(read_, other.read_);
    content_.swap(other.content_);
}

}  // namespace orbid::apps
