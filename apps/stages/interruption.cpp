#include "apps/stages/interruption.hpp"

#include <cerrno>
#include <csignal>

#include <semaphore.h>

namespace orbid::apps {

namespace {

// A signal handler can reach nothing but a global.
volatile std::sig_atomic_t stop_asked = 0;
sem_t awake;

extern "C" void ask_to_stop(int signal) {
    if (stop_asked != 0) {
        std::signal(signal, SIG_DFL);
        std::raise(signal);
        return;
    }
    const int former = errno;
    stop_asked = 1;
    sem_post(&awake);
    errno = former;
}

}  // namespace

InterruptionGuard::InterruptionGuard() {
    stop_asked = 0;
    sem_init(&awake, 0, 0);
    former_interrupt_ = std::signal(SIGINT, ask_to_stop);
    former_terminate_ = std::signal(SIGTERM, ask_to_stop);
}

InterruptionGuard::~InterruptionGuard() {
    std::signal(SIGINT, former_interrupt_);
    std::signal(SIGTERM, former_terminate_);
    sem_destroy(&awake);
}

bool InterruptionGuard::asked() const {
    return stop_asked != 0;
}

void InterruptionGuard::wait() const {
    while (sem_wait(&awake) != 0 && errno == EINTR) {
    }
}

void InterruptionGuard::wake() const {
    sem_post(&awake);
}

}  // namespace orbid::apps
