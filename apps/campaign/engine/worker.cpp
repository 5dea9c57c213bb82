#include "apps/campaign/engine/worker.hpp"

#include <chrono>
#include <deque>
#include <exception>
#include <optional>
#include <string>
#include <utility>

#include <nlohmann/json.hpp>

#include "apps/campaign/engine/task_message.hpp"

namespace orbid::apps {

namespace {

using estimator::RankMessage;
using estimator::Ranks;

/// Tasks dealt to this rank, and whether it is to stop.
class Orders {
public:
    explicit Orders(Ranks& ranks) : ranks_(ranks) {}

    /// Takes what has arrived, without waiting. True: it is to stop.
    bool look() {
        while (!stopped_) {
            std::optional<RankMessage> message = ranks_.receive(0, std::chrono::milliseconds(0));
            if (!message) break;
            take(*message);
        }
        return stopped_;
    }
    /// The next task; waits for one. Nothing: it is to stop.
    std::optional<std::int64_t> next() {
        look();
        while (!stopped_ && numbers_.empty())
            take(ranks_.receive(0));
        if (stopped_) return std::nullopt;
        const std::int64_t number = numbers_.front();
        numbers_.pop_front();
        return number;
    }

private:
    void take(const RankMessage& message) {
        if (message.lost) {
            stopped_ = true;
            return;
        }
        const TaskMessage order = unpacked(message.content);
        if (order.kind == TaskMessage::Kind::task)
            numbers_.push_back(order.number);
        else
            stopped_ = true;
    }

    Ranks& ranks_;
    std::deque<std::int64_t> numbers_;
    bool stopped_ = false;
};

/// The campaign that rank 0 sends first; nothing when there is none to take up.
std::optional<CampaignTasks> received_tasks(Ranks& ranks) {
    const RankMessage first = ranks.receive(0);
    if (first.lost) return std::nullopt;
    const TaskMessage message = unpacked(first.content);
    if (message.kind != TaskMessage::Kind::campaign) return std::nullopt;
    return CampaignTasks(Campaign::from_document(nlohmann::ordered_json::parse(message.text)));
}

}  // namespace

int serve_tasks(Ranks& ranks, const TaskRunner& runner) {
    try {
        const std::optional<CampaignTasks> tasks = received_tasks(ranks);
        if (!tasks) return 0;
        const TaskWork work(*tasks, runner, ranks.rank());
        Orders orders(ranks);
        // A run asks often, and from several threads in turn: what has arrived is looked at ten times a second.
        auto looked = std::chrono::steady_clock::now();
        const auto stopped = [&] {
            const auto now = std::chrono::steady_clock::now();
            if (now - looked < std::chrono::milliseconds(100)) return false;
            looked = now;
            return orders.look();
        };
        while (const auto number = orders.next()) {
            TaskMessage done;
            done.kind = TaskMessage::Kind::outcome;
            done.outcome = work.run(*number, stopped);
            if (done.outcome.state == TaskState::waiting) break;
            ranks.send(0, packed(done));
        }
        return 0;
    } catch (const std::exception& error) {
        TaskMessage refusal;
        refusal.kind = TaskMessage::Kind::refusal;
        refusal.text = error.what();
        ranks.send(0, packed(refusal));
        return 1;
    }
}

}  // namespace orbid::apps
