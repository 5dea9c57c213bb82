// The plug-in orbid-mpi.so: ranks that MPI has started. The only file that includes MPI; nothing links it.
#define OMPI_SKIP_MPICXX 1
#define MPICH_SKIP_MPICXX 1
#include <mpi.h>

#include <algorithm>
#include <csignal>
#include <cstdlib>
#include <exception>
#include <list>
#include <stdexcept>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "apps/ranks/rank_plugin.hpp"
#include "apps/ranks/waiting.hpp"
#include "estimator/ranks/rank_inbox.hpp"

namespace orbid::apps {
namespace {

using estimator::RankInbox;
using estimator::RankMessage;

/// Counts of MPI are int: longer messages go in parts.
constexpr std::size_t longest_part = std::size_t{32} << 20;
/// What a part is: MPI keeps the order of one sender's messages whatever their tags.
enum Tag : int { more_follows, last_part, ended };

/// Sleeps between two questions to MPI, which itself waits at full speed: longer and longer, up to a millisecond.
class Pause {
public:
    void sleep() {
        std::this_thread::sleep_for(length_);
        length_ = std::min(2 * length_, std::chrono::microseconds(1000));
    }

private:
    std::chrono::microseconds length_{10};
};

void abort_all(int status, void*) {
    MPI_Abort(MPI_COMM_WORLD, status != 0 ? status : 1);
}

class MpiRanks final : public estimator::Ranks {
public:
    MpiRanks() : exceptions_(std::uncaught_exceptions()) {
        // Threads of a computation ask in turn whether rank 0 wants it to stop.
        int given = MPI_THREAD_SINGLE;
        MPI_Init_thread(nullptr, nullptr, MPI_THREAD_SERIALIZED, &given);
        if (given < MPI_THREAD_SERIALIZED) {
            MPI_Finalize();
            throw std::runtime_error("this MPI cannot be called by several threads in turn (MPI_THREAD_SERIALIZED)");
        }
        MPI_Comm_rank(MPI_COMM_WORLD, &rank_);
        MPI_Comm_size(MPI_COMM_WORLD, &count_);
        parts_.resize(static_cast<std::size_t>(count_));
        lost_.resize(static_cast<std::size_t>(count_));
        if (rank_ == 0) return;
        // Batch systems send these to all ranks at once. Rank 0 answers: it stores what there is, and asks all to stop.
        std::signal(SIGINT, SIG_IGN);
        std::signal(SIGTERM, SIG_IGN);
    }
    ~MpiRanks() override {
        if (std::uncaught_exceptions() > exceptions_) {
            // Not now: whoever catches it has something to say.
            ::on_exit(abort_all, nullptr);
            return;
        }
        finish();
        MPI_Finalize();
    }

    [[nodiscard]] int rank() const override { return rank_; }
    [[nodiscard]] int count() const override { return count_; }
    void send(int to, std::span<const std::byte> content) override;
    [[nodiscard]] std::optional<RankMessage> receive(int from, std::chrono::milliseconds patience) override;

private:
    /// A message that MPI may still be reading.
    struct Sent {
        std::vector<std::byte> content;
        std::vector<MPI_Request> parts;
    };

    void post(int to, std::span<const std::byte> part, Tag tag, Sent& sent) const;
    bool exchange();
    void take_part(int from, Tag tag, int length);
    void finish();

    int exceptions_;  ///< in flight when it began
    int rank_ = 0;
    int count_ = 1;
    RankInbox inbox_;
    std::list<Sent> sent_;
    std::vector<std::vector<std::byte>> parts_;  ///< by rank: of the message that it is sending
    std::vector<bool> lost_;                     ///< by rank: it has ended
};

void MpiRanks::post(int to, std::span<const std::byte> part, Tag tag, Sent& sent) const {
    sent.parts.emplace_back();
    MPI_Isend(part.data(), static_cast<int>(part.size()), MPI_BYTE, to, tag, MPI_COMM_WORLD, &sent.parts.back());
}

void MpiRanks::send(int to, std::span<const std::byte> content) {
    if (to < 0 || to >= count_)
        throw std::out_of_range("there is no rank " + std::to_string(to) + " among " + std::to_string(count_));
    if (to == rank_) {
        inbox_.put({rank_, {content.begin(), content.end()}, false});
        return;
    }
    if (to != 0 && rank_ != 0)
        throw std::logic_error("rank " + std::to_string(rank_) + " sends to rank " + std::to_string(to) +
                               ": messages are exchanged with rank 0 alone");
    if (lost_[static_cast<std::size_t>(to)]) return;
    Sent& sent = sent_.emplace_back();
    sent.content.assign(content.begin(), content.end());
    std::span<const std::byte> rest(sent.content);
    for (; rest.size() > longest_part; rest = rest.subspan(longest_part))
        post(to, rest.first(longest_part), more_follows, sent);
    post(to, rest, last_part, sent);
    // Rank 0 soon asks for messages again, which moves this one on; the others compute for minutes in between.
    Pause pause;
    for (exchange(); rank_ != 0 && !sent_.empty(); exchange())
        pause.sleep();
}

std::optional<RankMessage> MpiRanks::receive(int from, std::chrono::milliseconds patience) {
    const Waiting waiting(patience);
    Pause pause;
    for (;;) {
        const bool last = waiting.left() == 0;
        while (exchange()) {
        }
        if (auto message = inbox_.take(from)) return message;
        if (last) return std::nullopt;
        pause.sleep();
    }
}

/// Takes in a part that has arrived, and forgets what has been sent. @return whether there was one
bool MpiRanks::exchange() {
    sent_.remove_if([](Sent& sent) {
        int done = 0;
        MPI_Testall(static_cast<int>(sent.parts.size()), sent.parts.data(), &done, MPI_STATUSES_IGNORE);
        return done != 0;
    });
    int there = 0;
    MPI_Status status;
    MPI_Iprobe(MPI_ANY_SOURCE, MPI_ANY_TAG, MPI_COMM_WORLD, &there, &status);
    if (there == 0) return false;
    int length = 0;
    MPI_Get_count(&status, MPI_BYTE, &length);
    take_part(status.MPI_SOURCE, static_cast<Tag>(status.MPI_TAG), length);
    return true;
}

void MpiRanks::take_part(int from, Tag tag, int length) {
    std::vector<std::byte>& parts = parts_[static_cast<std::size_t>(from)];
    const std::size_t before = parts.size();
    parts.resize(before + static_cast<std::size_t>(length));
    MPI_Recv(parts.data() + before, length, MPI_BYTE, from, tag, MPI_COMM_WORLD, MPI_STATUS_IGNORE);
    if (tag == more_follows) return;
    if (tag == ended) lost_[static_cast<std::size_t>(from)] = true;
    inbox_.put({from, std::exchange(parts, {}), tag == ended});
}

/// Tells that this rank has ended, and drops what still comes until those that could send something have ended too:
/// what they have sent is taken, so that none of them waits for it.
void MpiRanks::finish() {
    const int first = rank_ == 0 ? 1 : 0, last = rank_ == 0 ? count_ - 1 : 0;
    Sent& sent = sent_.emplace_back();
    for (int other = first; rank_ != other && other <= last; ++other)
        post(other, {}, ended, sent);
    Pause pause;
    const auto all_lost = [&] {
        for (int other = first; rank_ != other && other <= last; ++other)
            if (!lost_[static_cast<std::size_t>(other)]) return false;
        return true;
    };
    while (exchange() || !sent_.empty() || !all_lost())
        pause.sleep();
}

estimator::Ranks* ranks() {
    return new MpiRanks;
}

constexpr RankPlugin plugin{RankPlugin::current, ORBID_VERSION, ranks};

}  // namespace
}  // namespace orbid::apps

extern "C" __attribute__((visibility("default"))) const orbid::apps::RankPlugin* orbid_rank_plugin();
const orbid::apps::RankPlugin* orbid_rank_plugin() {
    return &orbid::apps::plugin;
}
