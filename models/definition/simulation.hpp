#pragma once

#include <cstddef>
#include <functional>
#include <string_view>

#pragma GCC visibility push(default)

namespace orbid::models {

enum class Kind { forced, autonomous, map };

/// The variable in which durations of a flow are measured.
///
/// phase  tau = omega t [rad] (forced models only): the section stays where it is when omega changes,
///        sensitivities to omega are complete.
/// time   t [s]; iterations (whole numbers) for maps.
enum class Clock { phase, time };

/// How a flow ended. Anything but ok means "cannot be simulated here": states after `stopped_after` are undefined.
enum class FlowStatus {
    ok,
    step_budget,  ///< maximum_steps were taken
    not_finite,   ///< the state left the range of finite numbers
    grazing,      ///< a switching surface was touched without crossing it: derivatives do not exist there
    no_crossing,  ///< the section was not reached within the longest return time allowed
    no_input,     ///< a measured input does not reach that far
    held_twice,   ///< two switching surfaces hold the solution at once
    not_smooth    ///< the equations jump at these parameters, and the stepper takes smooth ones only
};

[[nodiscard]] std::string_view description(FlowStatus status);

struct FlowOptions {
    double relative_tolerance = 1e-12;    ///< local error per step relative to the state, > 0
    double absolute_tolerance = 1e-12;    ///< local error per step, in System::state_size(), > 0
    std::size_t maximum_steps = 1000000;  ///< accepted and rejected steps of one call, > 0
    /// Asked once per step; if it says so, the call throws Stopped. It outlives the call; nullptr: never asked.
    const std::function<bool()>* interrupted = nullptr;
};

}  // namespace orbid::models

#pragma GCC visibility pop
