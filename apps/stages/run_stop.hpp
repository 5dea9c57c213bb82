#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <string>
#include <utility>

#include "apps/stages/interruption.hpp"

namespace orbid::apps {

/// When the computations of a run are left after a stop was requested: what they all ask, once per step.
///
/// Computations that are useless unless finished (a simulation, a search for cycles) are left at once. Minimisations,
/// profiles, samplers, searches of the model's orbits and continuations stop by themselves with what they have. They
/// are left only when a step takes longer than a fifth of a second. Thread-safe but for shows() and result().
class RunStop {
public:
    explicit RunStop(const Interruption& interruption) : interruption_(interruption) {}
    RunStop(const RunStop&) = delete;
    RunStop& operator=(const RunStop&) = delete;

    /// The computation that asks is to throw models::Stopped.
    [[nodiscard]] bool now() const;

    /// The content of result.json if the run is left from now on, made when it is left; empty: none.
    void shows(std::function<std::string()> result) { result_ = std::move(result); }
    void shows(std::string result) {
        result_ = [result = std::move(result)] { return result; };
    }
    [[nodiscard]] std::string result() const { return result_ ? result_() : std::string(); }

    /// While it exists, computations are left at once.
    class AtOnce {
    public:
        explicit AtOnce(RunStop& stop) : stop_(stop) { ++stop_.at_once_; }
        ~AtOnce() { --stop_.at_once_; }
        AtOnce(const AtOnce&) = delete;
        AtOnce& operator=(const AtOnce&) = delete;

    private:
        RunStop& stop_;
    };

private:
    const Interruption& interruption_;
    std::atomic<int> at_once_{0};
    mutable std::atomic<std::int64_t> noticed_{0};  ///< [ns] of the steady clock; 0: not yet
    std::function<std::string()> result_;
};

}  // namespace orbid::apps
