#include "apps/stages/departure.hpp"

#include <chrono>
#include <utility>

namespace orbid::apps {

namespace {

// A step of a minimisation takes a fraction of a second for series of 1e5 points; whoever waits longer than this for a
// program to stop presses the keys again.
constexpr std::chrono::seconds patience{5};

}  // namespace

Departure::Departure(const InterruptionGuard* interruption, std::function<void(const std::string& result)> leave)
    : interruption_(interruption), leave_(std::move(leave)) {
    if (leave_) thread_ = std::thread([this] { watch(); });
}

Departure::~Departure() {
    {
        const std::lock_guard lock(mutex_);
        over_ = true;
    }
    changed_.notify_all();
    if (interruption_ != nullptr) interruption_->wake();
    if (thread_.joinable()) thread_.join();
}

void Departure::shows(std::string result) {
    const std::lock_guard lock(mutex_);
    result_ = std::move(result);
}

void Departure::watch() {
    interruption_->wait();
    std::unique_lock lock(mutex_);
    changed_.wait_for(lock, patience, [this] { return allowed_ > 0 || over_; });
    if (!over_) leave_(result_);
}

Departure::Allowed::Allowed(Departure& departure) : departure_(departure) {
    {
        const std::lock_guard lock(departure_.mutex_);
        ++departure_.allowed_;
    }
    departure_.changed_.notify_all();
}

Departure::Allowed::~Allowed() {
    const std::lock_guard lock(departure_.mutex_);
    --departure_.allowed_;
}

}  // namespace orbid::apps
