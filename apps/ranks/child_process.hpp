#pragma once

#include <functional>
#include <string>
#include <utility>

#include <sys/types.h>

namespace orbid::apps {

/// A process forked from this one, without exec: it begins with all that this process has in memory.
///
/// Only the thread that forks lives on in it, so this process must have one thread alone. The child dies when the
/// thread that forked it ends, however that happens. It ignores SIGINT, SIGTERM and SIGHUP, which a terminal or a batch
/// system sends to all processes at once; handlers of other signals are those of the system. It leaves by _exit:
/// nothing that this process has open is flushed or destroyed twice.
class ChildProcess {
public:
    /// None.
    ChildProcess() = default;
    /// Runs `work` in a new process, whose exit status is what `work` returns, or 1 when an exception leaves it.
    /// @throws std::logic_error when this process has several threads, std::system_error when none can be forked.
    explicit ChildProcess(const std::function<int()>& work);
    ChildProcess(ChildProcess&& other) noexcept : id_(std::exchange(other.id_, 0)) {}
    ChildProcess& operator=(ChildProcess&& other) noexcept {
        std::swap(id_, other.id_);
        return *this;
    }
    /// Kills it if it runs.
    ~ChildProcess();

    /// It was started, and nobody has waited for its end.
    [[nodiscard]] explicit operator bool() const { return id_ > 0; }
    [[nodiscard]] pid_t id() const { return id_; }
    /// Ends it by SIGKILL; wait() is still needed.
    void kill() const;
    /// Waits for its end. @return "exit status 0" or the name of the signal that ended it, such as "SIGSEGV"
    [[nodiscard]] std::string wait();

private:
    pid_t id_ = 0;
};

}  // namespace orbid::apps
