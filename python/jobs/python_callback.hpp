#pragma once

#include <mutex>
#include <optional>

#include <pybind11/pybind11.h>

namespace orbid::python {

/// A function of the caller that is told of a computation, from any thread. What it raises is kept: the computation is
/// stopped, and it is raised again.
class PythonCallback {
public:
    [[nodiscard]] bool failed() const {
        const std::lock_guard lock(mutex_);
        return raised_.has_value();
    }
    /// Calls Python with the interpreter's lock, unless an earlier call has failed.
    template <class Call>
    void tell(const Call& call) {
        if (failed()) return;
        const pybind11::gil_scoped_acquire lock;
        try {
            call();
        } catch (pybind11::error_already_set& error) {
            const std::lock_guard kept(mutex_);
            raised_.emplace(std::move(error));
        }
    }
    /// @throws pybind11::error_already_set
    void raise_again() const {
        if (raised_) throw pybind11::error_already_set(*raised_);
    }

private:
    mutable std::mutex mutex_;
    std::optional<pybind11::error_already_set> raised_;
};

}  // namespace orbid::python
