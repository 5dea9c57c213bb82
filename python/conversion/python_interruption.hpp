#pragma once

#include <functional>
#include <optional>
#include <utility>

#include "models/system/stopped.hpp"

namespace orbid::python {

/// Computes without the lock of the interpreter, on its own thread, while the calling thread handles signals. Call it
/// holding the lock; `compute` may take the lock (pybind11::gil_scoped_acquire) to call Python.
///
/// @param compute  calls `stopped` between its steps, from any thread, and returns soon when it is true.
/// @return whether a signal requested a stop (Ctrl-C): the result is then the best so far. KeyboardInterrupt is raised
///         only if a second such signal comes before `compute` has returned.
/// @throws what `compute` throws; what a signal's handler raises other than KeyboardInterrupt, once `compute` has
///         returned.
[[nodiscard]] bool computed_until_interrupted(const std::function<void(const std::function<bool()>& stopped)>& compute);

/// The same where a partial result is useless. @throws KeyboardInterrupt
void compute_interruptibly(const std::function<void(const std::function<bool()>& stopped)>& compute);

/// What a computation returns that goes on to its end. @throws KeyboardInterrupt
template <class Compute>
[[nodiscard]] auto computed_interruptibly(const Compute& compute) {
    std::optional<decltype(compute())> result;
    compute_interruptibly([&](const auto&) { result.emplace(compute()); });
    return std::move(*result);
}

/// The same, with options.interrupted set while it computes: a stop leaves it by models::Stopped.
template <class Options, class Compute>
[[nodiscard]] auto computed_interruptibly(Options& options, const Compute& compute) {
    std::optional<decltype(compute())> result;
    compute_interruptibly([&](const std::function<bool()>& stopped) {
        options.interrupted = stopped;
        try {
            result.emplace(compute());
        } catch (const models::Stopped&) {
            if (!stopped()) throw;
        }
    });
    return std::move(*result);
}

}  // namespace orbid::python
