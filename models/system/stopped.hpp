#pragma once

#include <exception>
#include <functional>

#pragma GCC visibility push(default)

namespace orbid::models {

/// Thrown by a computation whose caller said stop, and of which no part is of use.
class Stopped final : public std::exception {
public:
    [[nodiscard]] const char* what() const noexcept override { return "stopped by the caller"; }
};

/// Here as a whole: equations that are compiled at run time find nothing in the library.
/// @throws Stopped if the function, called `interrupted` in options, says so; empty or nullptr: never
inline void stop_if_asked(const std::function<bool()>& interrupted) {
    if (interrupted && interrupted()) throw Stopped();
}
inline void stop_if_asked(const std::function<bool()>* interrupted) {
    if (interrupted != nullptr) stop_if_asked(*interrupted);
}

}  // namespace orbid::models

#pragma GCC visibility pop
