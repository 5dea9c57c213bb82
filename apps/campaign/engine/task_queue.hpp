#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <optional>
#include <set>
#include <utility>
#include <vector>

#include "apps/campaign/plan/campaign_tasks.hpp"

namespace orbid::apps {

/// Waiting tasks, the longest first: what runs last should be short, so that no rank waits long for another. Tasks that
/// differ by replicate alone are expected to take as long as those that have ended did; where none has, they come
/// first.
class TaskQueue {
public:
    TaskQueue(const CampaignTasks& tasks, const std::vector<std::int64_t>& waiting);

    [[nodiscard]] bool empty() const { return count_ == 0; }
    [[nodiscard]] std::int64_t count() const { return count_; }
    /// The next task; nothing when there is none.
    [[nodiscard]] std::optional<std::int64_t> next();
    /// A task that was dealt and not run waits again.
    void put_back(std::int64_t number);
    /// A task has ended.
    void ended(std::int64_t number, double seconds);
    /// Time of a task that has not run [s]: mean of its group, else of all; 0 before any has ended.
    [[nodiscard]] double expected(std::int64_t number) const { return expected_of(group_of(number)); }
    /// Of all waiting tasks together [s].
    [[nodiscard]] double expected_total() const;

private:
    struct Group {
        std::deque<std::int64_t> waiting;
        double seconds = 0.0;
        std::int64_t ended = 0;
    };
    [[nodiscard]] std::int64_t group_of(std::int64_t number) const { return number / group_size_; }
    [[nodiscard]] double expected_of(std::int64_t group) const;
    [[nodiscard]] double urgency(const Group& group) const;

    std::int64_t group_size_ = 1;
    std::map<std::int64_t, Group> groups_;
    std::set<std::pair<double, std::int64_t>> order_;  ///< -urgency, group; those with waiting tasks
    std::int64_t count_ = 0;
    double seconds_ = 0.0;
    std::int64_t ended_ = 0;
};

}  // namespace orbid::apps
