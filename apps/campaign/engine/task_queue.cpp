#include "apps/campaign/engine/task_queue.hpp"

#include <algorithm>
#include <limits>

namespace orbid::apps {

namespace {

/// More groups would cost more than they tell: neighbours are taken together then.
constexpr std::int64_t most_groups = 10'000;

}  // namespace

TaskQueue::TaskQueue(const CampaignTasks& tasks, const std::vector<std::int64_t>& waiting)
    : group_size_(std::max(tasks.campaign().replicates, (tasks.count() + most_groups - 1) / most_groups)),
      count_(static_cast<std::int64_t>(waiting.size())) {
    for (const std::int64_t number : waiting)
        groups_[group_of(number)].waiting.push_back(number);
    for (const auto& [number, group] : groups_)
        order_.insert({-urgency(group), number});
}

double TaskQueue::urgency(const Group& group) const {
    return group.ended > 0 ? group.seconds / static_cast<double>(group.ended) : std::numeric_limits<double>::infinity();
}

double TaskQueue::expected_of(std::int64_t number) const {
    const auto group = groups_.find(number);
    if (group != groups_.end() && group->second.ended > 0) return urgency(group->second);
    return ended_ > 0 ? seconds_ / static_cast<double>(ended_) : 0.0;
}

double TaskQueue::expected_total() const {
    double total = 0.0;
    for (const auto& [urgency, number] : order_)
        total += expected_of(number) * static_cast<double>(groups_.at(number).waiting.size());
    return total;
}

std::optional<std::int64_t> TaskQueue::next() {
    if (order_.empty()) return std::nullopt;
    // Of groups that nothing is known of, each gives one task before any gives a second one.
    const auto first = order_.begin();
    const auto [urgency, number] = *first;
    Group& group = groups_.at(number);
    const std::int64_t task = group.waiting.front();
    group.waiting.pop_front();
    --count_;
    order_.erase(first);
    if (!group.waiting.empty()) {
        const bool unknown = group.ended == 0;
        order_.insert({unknown ? std::min(0.0, -expected_of(number)) : urgency, number});
    }
    return task;
}

void TaskQueue::put_back(std::int64_t number) {
    Group& group = groups_[group_of(number)];
    std::erase_if(order_, [&](const auto& entry) { return entry.second == group_of(number); });
    group.waiting.push_front(number);
    ++count_;
    order_.insert({-urgency(group), group_of(number)});
}

void TaskQueue::ended(std::int64_t number, double seconds) {
    const std::int64_t index = group_of(number);
    Group& group = groups_[index];
    const bool waits = !group.waiting.empty();
    if (waits) {
        // The key may be the group's urgency or, while unknown, a guess.
        auto entry = order_.find({-urgency(group), index});
        if (entry == order_.end())
            entry = std::find_if(order_.begin(), order_.end(), [&](const auto& each) { return each.second == index; });
        order_.erase(entry);
    }
    group.seconds += seconds;
    ++group.ended;
    seconds_ += seconds;
    ++ended_;
    if (waits) order_.insert({-urgency(group), index});
}

}  // namespace orbid::apps
