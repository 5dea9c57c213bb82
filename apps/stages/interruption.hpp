#pragma once

namespace orbid::apps {

/// Whether a stop of the run was requested. Thread-safe.
class Interruption {
public:
    virtual ~Interruption() = default;
    [[nodiscard]] virtual bool asked() const = 0;
    /// The same within some milliseconds, for what asks a million times a second.
    [[nodiscard]] virtual bool asked_often() const { return asked(); }

protected:
    Interruption() = default;
    Interruption(const Interruption&) = default;
    Interruption& operator=(const Interruption&) = default;
};

/// From construction on, the first Ctrl-C (SIGINT), SIGTERM or SIGHUP (a terminal that was closed) only requests a
/// stop: the run stores a valid result with status `interrupted`. A second one ends the program at once. SIGHUP stays
/// ignored where it is (nohup). SIGPIPE is ignored from then on, also afterwards, when the last output is written:
/// whoever read it has gone, and the results are still stored. Destruction restores the other handlers. Only one may
/// exist at a time.
class InterruptionGuard final : public Interruption {
public:
    InterruptionGuard();
    ~InterruptionGuard() override;
    InterruptionGuard(const InterruptionGuard&) = delete;
    InterruptionGuard& operator=(const InterruptionGuard&) = delete;

    /// A stop was requested.
    [[nodiscard]] bool asked() const override;

private:
    using Handler = void (*)(int);
    Handler former_interrupt_;
    Handler former_terminate_;
    Handler former_hangup_;
};

}  // namespace orbid::apps
