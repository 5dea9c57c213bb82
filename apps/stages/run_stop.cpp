#include "apps/stages/run_stop.hpp"

#include <chrono>

namespace orbid::apps {

namespace {

// Whoever waits longer than a third of a second for a program to stop presses the keys again.
constexpr std::int64_t patience_ns = 200'000'000;

}  // namespace

bool RunStop::now() const {
    if (!interruption_.asked_often()) return false;
    if (at_once_ > 0) return true;
    const std::int64_t now =
        std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::steady_clock::now().time_since_epoch())
            .count();
    std::int64_t first = 0;
    return !noticed_.compare_exchange_strong(first, now) && now - first > patience_ns;
}

}  // namespace orbid::apps
