#pragma once

#include <cstddef>
#include <functional>
#include <mutex>

namespace orbid::estimator {

/// How many of several parts computed in parallel are done; tells one at a time.
class FinishedCount {
public:
    /// @param tell  may be empty; it outlives this
    FinishedCount(const std::function<void(int finished, int total)>& tell, std::size_t total)
        : tell_(tell), total_(static_cast<int>(total)) {}

    /// One more is done.
    void add() {
        if (!tell_) return;
        const std::lock_guard lock(mutex_);
        tell_(++finished_, total_);
    }

private:
    const std::function<void(int finished, int total)>& tell_;
    std::mutex mutex_;
    int total_;
    int finished_ = 0;
};

}  // namespace orbid::estimator
