#include "python/conversion/python_interruption.hpp"

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <exception>
#include <mutex>
#include <optional>
#include <thread>

#include <pybind11/pybind11.h>

namespace orbid::python {

namespace py = pybind11;

namespace {

/// Handlers of signals are Python functions, which the main thread runs when it asks for them: often enough for a
/// person, seldom enough to cost nothing.
constexpr std::chrono::milliseconds between_questions{20};

/// What handlers of signals raised while something was computed.
struct Raised {
    std::optional<py::error_already_set> error;
    bool again = false;  ///< a second request to stop: then nothing is wanted any more
};

/// Handlers of signals that have come since the last call run now; what they raise is kept.
void ask_signals(Raised& raised) {
    const py::gil_scoped_acquire lock;
    if (PyErr_CheckSignals() == 0) return;
    py::error_already_set error;
    raised.again = raised.again || (raised.error && error.matches(PyExc_KeyboardInterrupt));
    if (!raised.error || raised.error->matches(PyExc_KeyboardInterrupt)) raised.error.emplace(std::move(error));
}

}  // namespace

bool computed_until_interrupted(const std::function<void(const std::function<bool()>& stopped)>& compute) {
    std::atomic<bool> stop = false;
    std::exception_ptr failure;
    std::mutex mutex;
    std::condition_variable changed;
    bool done = false;
    Raised raised;
    {
        const py::gil_scoped_release unlocked;
        std::thread worker([&] {
            try {
                compute([&stop] { return stop.load(); });
            } catch (...) {
                failure = std::current_exception();
            }
            const std::lock_guard lock(mutex);
            done = true;
            changed.notify_one();
        });
        for (std::unique_lock lock(mutex); !changed.wait_for(lock, between_questions, [&] { return done; });) {
            lock.unlock();
            ask_signals(raised);
            if (raised.error) stop = true;
            lock.lock();
        }
        worker.join();
    }
    if (failure) std::rethrow_exception(failure);
    if (!raised.error) return false;
    if (raised.again || !raised.error->matches(PyExc_KeyboardInterrupt)) throw py::error_already_set(*raised.error);
    return true;
}

void compute_interruptibly(const std::function<void(const std::function<bool()>& stopped)>& compute) {
    if (!computed_until_interrupted(compute)) return;
    PyErr_SetNone(PyExc_KeyboardInterrupt);
    throw py::error_already_set();
}

}  // namespace orbid::python
