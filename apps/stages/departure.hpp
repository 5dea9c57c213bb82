#pragma once

#include <condition_variable>
#include <functional>
#include <mutex>
#include <string>
#include <thread>

#include "apps/stages/interruption.hpp"

namespace orbid::apps {

/// Leaves a run when a stop is requested during a computation that is useless unless finished (a simulation, a search
/// for cycles). Results so far are stored, and the program ends. Minimisations, profiles, samplers, searches of the
/// model's orbits and continuations stop by themselves with what they have. They are left only when a step takes longer
/// than `patience`.
class Departure {
public:
    /// @param leave  stores the results so far, given the content of result.json (empty: none to store), and ends the
    ///               program; called on its own thread, at most once. Empty: the run is never left.
    /// @param interruption  not null where `leave` is given.
    Departure(const InterruptionGuard* interruption, std::function<void(const std::string& result)> leave);
    ~Departure();
    Departure(const Departure&) = delete;
    Departure& operator=(const Departure&) = delete;

    /// The content of result.json if the run is left from now on.
    void shows(std::string result);

    /// While it exists the run may be left at any moment.
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
