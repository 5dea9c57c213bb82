#include "apps/stages/interruption.hpp"

#include <csignal>

namespace orbid::apps {

namespace {

// A signal handler can reach nothing but a global.
volatile std::sig_atomic_t stop_asked = 0;

extern "C" void ask_to_stop(int signal) {
    if (stop_asked != 0) {
        std::signal(signal, SIG_DFL);
        std::raise(signal);
        return;
    }
    stop_asked = 1;
}

}  // namespace

InterruptionGuard::InterruptionGuard() {
    stop_asked = 0;
    former_interrupt_ = std::signal(SIGINT, ask_to_stop);
    former_terminate_ = std::signal(SIGTERM, ask_to_stop);
}

InterruptionGuard::~InterruptionGuard() {
    std::signal(SIGINT, former_interrupt_);
    std::signal(SIGTERM, former_terminate_);
}

bool InterruptionGuard::asked() const {
    return stop_asked != 0;
}

}  // namespace orbid::apps
