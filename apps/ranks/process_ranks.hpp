#pragma once

#include <functional>
#include <string>
#include <vector>

#include "apps/ranks/child_process.hpp"
#include "apps/ranks/message_channel.hpp"
#include "estimator/ranks/rank_inbox.hpp"
#include "estimator/ranks/ranks.hpp"

namespace orbid::apps {

/// Rank 0 of processes of one machine: this process, which forks the others. Rank 0 exchanges messages with each of
/// them, and they with none but rank 0: sending between two of them is a std::logic_error.
///
/// Sending never waits in rank 0: what a process does not take yet is sent on whenever rank 0 sends or receives. In the
/// other processes sending waits until rank 0 has taken the message. What ends a process, an exception or a signal,
/// ends it alone; rank 0 is told by a message that is lost, and may start it anew. When rank 0 ends, so do all others.
class ProcessRanks final : public estimator::Ranks {
public:
    /// What a process does; its exit status is what this returns.
    using Child = std::function<int(estimator::Ranks&)>;

    /// Forks `count` - 1 processes, each of which runs `child` as its rank and never returns from here. The caller must
    /// be the only thread of this process, here and in restart(), and must outlive the processes: ChildProcess says
    /// why.
    /// @throws std::invalid_argument when count < 1, otherwise as ChildProcess.
    ProcessRanks(int count, Child child);
    /// Kills what still runs.
    ~ProcessRanks() override;

    using Ranks::receive;
    [[nodiscard]] int rank() const override { return 0; }
    [[nodiscard]] int count() const override { return static_cast<int>(others_.size()) + 1; }
    void send(int to, std::span<const std::byte> content) override;
    [[nodiscard]] std::optional<estimator::RankMessage> receive(int from, std::chrono::milliseconds patience) override;

    /// How a process ended: "exit status 0", the name of a signal such as "SIGKILL", or "exception: " with its text.
    /// Empty until the message that it is lost has arrived.
    [[nodiscard]] const std::string& how_ended(int rank) const { return other(rank).ended; }
    /// Ends a process, whatever it does, as a time limit may ask for; its loss is told as always.
    void kill(int rank);
    /// Forks a process anew whose loss has been received; it has rank 0's memory as it is now.
    /// @throws std::logic_error when it has not been told as lost, otherwise as ChildProcess.
    void restart(int rank);

private:
    struct Other {
        ChildProcess process;
        MessageChannel channel;
        std::string ended;
        std::string failure;  ///< text of its exception
        bool told = false;    ///< its loss has been received
    };

    [[nodiscard]] std::size_t index(int rank) const;
    [[nodiscard]] const Other& other(int rank) const { return others_[index(rank)]; }
    [[nodiscard]] Other& other(int rank) { return others_[index(rank)]; }
    void start(int rank);
    void exchange(int patience_ms);
    void read(int rank);

    Child child_;
    std::vector<Other> others_;  ///< rank 1 is the first
    estimator::RankInbox inbox_;
};

}  // namespace orbid::apps
