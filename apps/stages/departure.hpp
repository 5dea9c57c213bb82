#pragma once

#include <condition_variable>
#include <functional>
#include <mutex>
#include <string>
#include <thread>

#include "apps/stages/interruption.hpp"

namespace orbid::apps {

/// Leaves a run that was asked to stop while it computes something that is worth nothing before its end (a
/// simulation, a search for cycles): what there is by then is stored, and the program ends. Minimisations, profiles,
/// samplers, searches of the model's orbits and continuations stop by themselves with what they have, and are left only
/// when one of their steps takes longer than `patience`.
class Departure {
public:
    /// @param leave  stores what there is, given the content of result.json (empty: there is none to be stored), and
    ///               ends the program; called on a thread of its own, at most once. Empty: the run is never left.
    /// @param interruption  not null where `leave` is given.
    Departure(const InterruptionGuard* interruption, std::function<void(const std::string& result)> leave);
    ~Departure();
    Departure(const Departure&) = delete;
    Departure& operator=(const Departure&) = delete;

    /// What result.json says when the run is left from now on.
    void shows(std::string result);

    /// While it lives the run may be left at any moment.
    class Allowed {
    public:
        explicit Allowed(Departure& departure);
        ~Allowed();
        Allowed(const Allowed&) = delete;
        Allowed& operator=(const Allowed&) = delete;

    private:
        Departure& departure_;
    };

private:
    void watch();

    const InterruptionGuard* interruption_;
    std::function<void(const std::string& result)> leave_;
    std::mutex mutex_;  ///< held while leaving: an Allowed that ends in between waits for the end of the program
    std::condition_variable changed_;
    std::string result_;
    int allowed_ = 0;
    bool over_ = false;
    std::thread thread_;
};

}  // namespace orbid::apps
