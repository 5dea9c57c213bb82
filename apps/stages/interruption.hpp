#pragma once

namespace orbid::apps {

/// Whether a run was asked to stop. Thread-safe.
class Interruption {
public:
    virtual ~Interruption() = default;
    [[nodiscard]] virtual bool asked() const = 0;

protected:
    Interruption() = default;
    Interruption(const Interruption&) = default;
    Interruption& operator=(const Interruption&) = default;
};

/// From its construction on, the first Ctrl-C (SIGINT) or SIGTERM only asks to stop: the run stores a valid result with
/// status `interrupted`. A second one ends the program at once. The former handlers return on destruction. One at a
/// time.
class InterruptionGuard final : public Interruption {
public:
    InterruptionGuard();
    ~InterruptionGuard() override;
    InterruptionGuard(const InterruptionGuard&) = delete;
    InterruptionGuard& operator=(const InterruptionGuard&) = delete;

    /// Somebody asked to stop.
    [[nodiscard]] bool asked() const override;
    /// Returns when somebody asks to stop, or wake() was called.
    void wait() const;
    void wake() const;

private:
    using Handler = void (*)(int);
    Handler former_interrupt_;
    Handler former_terminate_;
};

}  // namespace orbid::apps
