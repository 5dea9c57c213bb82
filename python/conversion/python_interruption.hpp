#pragma once

#include <functional>

namespace orbid::python {

/// Computes without the lock of the interpreter, on a thread of its own, while the calling thread looks after signals.
/// Call it holding the lock; `compute` may take the lock (pybind11::gil_scoped_acquire) to call Python.
///
/// @param compute  asks `stopped` between its steps, from any thread, and returns soon when it says yes.
/// @return a signal asked to stop (Ctrl-C): what was computed is the best until then. KeyboardInterrupt is not raised,
///         unless a second such signal comes before `compute` has returned.
/// @throws what `compute` throws; what a signal's handler raises other than KeyboardInterrupt, once `compute` has
///         returned.
[[nodiscard]] bool computed_until_interrupted(const std::function<void(const std::function<bool()>& stopped)>& compute);

/// The same where half a result is none. @throws KeyboardInterrupt
void compute_interruptibly(const std::function<void(const std::function<bool()>& stopped)>& compute);

}  // namespace orbid::python
