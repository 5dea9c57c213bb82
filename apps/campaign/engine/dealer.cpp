#include "apps/campaign/engine/dealer.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>

#include <fmt/format.h>

#include "apps/campaign/engine/task_message.hpp"

namespace orbid::apps {

namespace {

using estimator::RankMessage;
using estimator::Ranks;
using Clock = std::chrono::steady_clock;

/// A rank should have work for this long when an outcome is on its way [s].
constexpr double work_ahead = 0.02;
constexpr std::size_t most_ahead = 64;
/// As many outcomes at once as one transaction should have.
constexpr std::size_t most_stored = 2000;

double seconds_since(Clock::time_point begin) {
    return std::chrono::duration<double>(Clock::now() - begin).count();
}

}  // namespace

Dealer::Dealer(const CampaignTasks& tasks, Journal& journal, Crew& crew, DealerCalls calls)
    : tasks_(tasks),
      journal_(journal),
      crew_(crew),
      calls_(std::move(calls)),
      queue_(tasks, journal.waiting()),
      ranks_(static_cast<std::size_t>(crew.ranks().count())),
      counts_(journal.counts()) {}

bool Dealer::run() {
    for (int rank = 1; rank < static_cast<int>(ranks_.size()); ++rank)
        greet(rank);
    bool stopped = false;
    while (!stopped && (!queue_.empty() || in_work() > 0)) {
        deal();
        if (computing() == 0) throw std::runtime_error("no rank is left that computes");
        std::optional<RankMessage> message = crew_.ranks().receive(Ranks::any, std::chrono::milliseconds(100));
        while (message) {
            take(*message);
            if (arrived_.size() >= most_stored) break;
            message = crew_.ranks().receive(Ranks::any, std::chrono::milliseconds(0));
        }
        store();
        kill_late();
        tell();
        stopped = calls_.stopped && calls_.stopped();
    }
    for (int rank = 1; rank < static_cast<int>(ranks_.size()); ++rank)
        if (!ranks_[static_cast<std::size_t>(rank)].gone) crew_.ranks().send(rank, packed({}));
    return !stopped;
}

void Dealer::greet(int rank) {
    TaskMessage first;
    first.kind = TaskMessage::Kind::campaign;
    first.text = tasks_.campaign().document().dump();
    crew_.ranks().send(rank, packed(first));
}

/// Tasks that a rank has at most: one in work, and those that follow at once.
std::size_t Dealer::ahead() const {
    if (task_seconds_ <= 0.0) return 1;
    return 1 + std::min(most_ahead, static_cast<std::size_t>(work_ahead / task_seconds_ + 0.5));
}

void Dealer::deal() {
    // In turns, so that the last tasks are spread.
    for (std::size_t most = 1; most <= ahead() && !queue_.empty(); ++most)
        for (int rank = 1; rank < static_cast<int>(ranks_.size()); ++rank)
            deal_to(rank, most);
}

void Dealer::deal_to(int rank, std::size_t most) {
    Rank& to = ranks_[static_cast<std::size_t>(rank)];
    while (!to.gone && to.dealt.size() < most) {
        const auto number = queue_.next();
        if (!number) return;
        if (to.dealt.empty()) to.since = Clock::now();
        to.dealt.push_back(*number);
        TaskMessage task;
        task.kind = TaskMessage::Kind::task;
        task.number = *number;
        crew_.ranks().send(rank, packed(task));
    }
}

void Dealer::take(const RankMessage& message) {
    if (message.lost) return lose(message.from);
    TaskMessage told = unpacked(message.content);
    Rank& from = ranks_[static_cast<std::size_t>(message.from)];
    if (told.kind == TaskMessage::Kind::refusal)
        throw std::runtime_error(fmt::format("rank {}: {}", message.from, told.text));
    if (told.kind != TaskMessage::Kind::outcome || from.dealt.empty() || told.outcome.number != from.dealt.front())
        throw std::runtime_error(fmt::format("rank {} answers what it was not asked", message.from));
    from.dealt.pop_front();
    from.since = Clock::now();
    constexpr double memory = 0.9;
    task_seconds_ =
        task_seconds_ > 0.0 ? memory * task_seconds_ + (1.0 - memory) * told.outcome.seconds : told.outcome.seconds;
    queue_.ended(told.outcome.number, told.outcome.seconds);
    arrived_.push_back(std::move(told.outcome));
}

void Dealer::lose(int rank) {
    Rank& lost = ranks_[static_cast<std::size_t>(rank)];
    lost.gone = true;
    const std::string how = crew_.how_ended(rank);
    const double limit = tasks_.campaign().seconds;
    const bool late = limit > 0.0 && seconds_since(lost.since) > limit;
    // Who is killed from outside has done nothing wrong; but what takes all memory is killed again and again.
    constexpr int most_kills = 3;
    if (!lost.dealt.empty() && (late || how != "SIGKILL" || ++kills_[lost.dealt.front()] >= most_kills)) {
        TaskOutcome outcome;
        outcome.number = lost.dealt.front();
        outcome.state = TaskState::failed;
        outcome.rank = rank;
        outcome.seconds = seconds_since(lost.since);
        outcome.status = late ? "time_limit" : "crash";
        outcome.message = late ? fmt::format("no answer within {} s, and did not stop when asked", limit)
                               : fmt::format("its process has ended: {}", how);
        queue_.ended(outcome.number, outcome.seconds);
        arrived_.push_back(std::move(outcome));
        lost.dealt.pop_front();
    }
    for (; !lost.dealt.empty(); lost.dealt.pop_back())
        queue_.put_back(lost.dealt.back());
    if (calls_.before_fork) calls_.before_fork();
    if (!crew_.restart(rank)) return;
    lost.gone = false;
    greet(rank);
}

void Dealer::store() {
    if (arrived_.empty()) return;
    journal_.store(arrived_);
    for (const TaskOutcome& outcome : arrived_) {
        --counts_.waiting;
        ++(outcome.state == TaskState::failed ? counts_.failed : counts_.done);
    }
    arrived_.clear();
}

/// A run asks between its steps whether to stop. One that does not ask is ended with its process.
void Dealer::kill_late() {
    const double limit = tasks_.campaign().seconds;
    if (limit <= 0.0) return;
    constexpr double patience = 10.0;  // [s]
    for (int rank = 1; rank < static_cast<int>(ranks_.size()); ++rank) {
        const Rank& one = ranks_[static_cast<std::size_t>(rank)];
        if (!one.gone && !one.dealt.empty() && seconds_since(one.since) > 2.0 * limit + patience) crew_.kill(rank);
    }
}

std::int64_t Dealer::in_work() const {
    std::int64_t count = 0;
    for (const Rank& rank : ranks_)
        count += static_cast<std::int64_t>(rank.dealt.size());
    return count;
}

int Dealer::computing() const {
    return static_cast<int>(
        std::count_if(ranks_.begin() + 1, ranks_.end(), [](const Rank& rank) { return !rank.gone; }));
}

double Dealer::remaining() const {
    if (task_seconds_ <= 0.0) return std::numeric_limits<double>::quiet_NaN();
    double seconds = queue_.expected_total();
    for (const Rank& rank : ranks_)
        for (const std::int64_t number : rank.dealt)
            seconds +=
                queue_.expected(number) -
                (number == rank.dealt.front() ? std::min(seconds_since(rank.since), queue_.expected(number)) : 0.0);
    return seconds / std::max(1, computing());
}

void Dealer::tell() {
    constexpr std::chrono::milliseconds between(100);
    const auto now = Clock::now();
    if (!calls_.progress || now - told_ < between) return;
    told_ = now;
    calls_.progress(
        {tasks_.count(), counts_.done, counts_.failed, in_work(), computing(), seconds_since(begin_), remaining()});
}

}  // namespace orbid::apps
