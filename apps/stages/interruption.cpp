#include "apps/stages/interruption.hpp"

#include <atomic>
#include <csignal>

namespace orbid::apps {

namespace {

// A signal handler can reach nothing but a global, and of atomics only those without a lock.
std::atomic<bool> stop_asked = false;
static_assert(std::atomic<bool>::is_always_lock_free);

extern "C" void ask_to_stop(int signal) {
    if (stop_asked) {
        std::signal(signal, SIG_DFL);
        std::raise(signal);
        return;
    }
    stop_asked = true;
}

}  // namespace

InterruptionGuard::InterruptionGuard() {
    stop_asked = false;
    former_interrupt_ = std::signal(SIGINT, ask_to_stop);
    former_terminate_ = std::signal(SIGTERM, ask_to_stop);
    former_hangup_ = std::signal(SIGHUP, ask_to_stop);
    if (former_hangup_ == SIG_IGN) std::signal(SIGHUP, SIG_IGN);
    std::signal(SIGPIPE, SIG_IGN);
}

InterruptionGuard::~InterruptionGuard() {
    std::signal(SIGINT, former_interrupt_);
    std::signal(SIGTERM, former_terminate_);
    std::signal(SIGHUP, former_hangup_);
}

bool InterruptionGuard::asked() const {
    return stop_asked;
}

}  // namespace orbid::apps
