#include "apps/ranks/child_process.hpp"

#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <iterator>
#include <stdexcept>
#include <system_error>

#include <fmt/format.h>

namespace orbid::apps {
namespace {

/// @throws std::logic_error when this process has several threads: locks that others hold would never be released in a
/// child.
void require_one_thread() {
    std::error_code unknown;
    const std::filesystem::directory_iterator threads("/proc/self/task", unknown);
    if (unknown) return;
    if (const auto count = std::distance(threads, {}); count > 1)
        throw std::logic_error(
            fmt::format("ChildProcess: this process has {} threads, and is forked only while it has one", count));
}

/// Handlers of the parent, and the signals that it answers for all.
void reset_signals() {
    for (int signal = 1; signal < NSIG; ++signal) {
        struct sigaction action {};
        if (::sigaction(signal, nullptr, &action) != 0) continue;
        const bool handled =
            (action.sa_flags & SA_SIGINFO) != 0 || (action.sa_handler != SIG_DFL && action.sa_handler != SIG_IGN);
        if (handled) ::signal(signal, SIG_DFL);
    }
    ::signal(SIGINT, SIG_IGN);
    ::signal(SIGTERM, SIG_IGN);
    ::signal(SIGHUP, SIG_IGN);
}

[[noreturn]] void be_child(const std::function<int()>& work, pid_t parent, const sigset_t& signals) {
    ::prctl(PR_SET_PDEATHSIG, SIGKILL);
    // It may have died before that.
    if (::getppid() != parent) ::_exit(1);
    reset_signals();
    ::sigprocmask(SIG_SETMASK, &signals, nullptr);
    int status = 1;
    try {
        status = work();
    } catch (...) {
        // The exit status tells it; who wants the text catches in `work`.
    }
    ::_exit(status);
}

std::string name_of(int signal) {
    const char* const name = ::sigabbrev_np(signal);
    return name != nullptr ? fmt::format("SIG{}", name) : fmt::format("signal {}", signal);
}

}  // namespace

ChildProcess::ChildProcess(const std::function<int()>& work) {
    require_one_thread();
    // What is left in a buffer would be in the child's, too.
    std::fflush(nullptr);
    const pid_t parent = ::getpid();
    // A handler of the parent must not run in the child before it is reset.
    sigset_t all, signals;
    ::sigfillset(&all);
    ::sigprocmask(SIG_SETMASK, &all, &signals);
    const pid_t id = ::fork();
    const int failure = errno;
    if (id == 0) be_child(work, parent, signals);
    ::sigprocmask(SIG_SETMASK, &signals, nullptr);
    if (id < 0) throw std::system_error(failure, std::generic_category(), "a further process cannot be started");
    id_ = id;
}

ChildProcess::~ChildProcess() {
    if (id_ <= 0) return;
    kill();
    while (::waitpid(id_, nullptr, 0) < 0 && errno == EINTR) {
    }
}

void ChildProcess::kill() const {
    if (id_ > 0) ::kill(id_, SIGKILL);
}

std::string ChildProcess::wait() {
    int status = 0;
    pid_t waited = 0;
    do {
        waited = ::waitpid(id_, &status, 0);
    } while (waited < 0 && errno == EINTR);
    id_ = 0;
    // Where SIGCHLD is ignored, the system forgets how a process ended.
    if (waited < 0) return "unknown status";
    return WIFSIGNALED(status) ? name_of(WTERMSIG(status)) : fmt::format("exit status {}", WEXITSTATUS(status));
}

}  // namespace orbid::apps
