#pragma once

#include <exception>
#include <functional>

#pragma GCC visibility push(default)

namespace orbid::models {

/// Thrown by a computation whose caller said stop, and of which no part is of use.
class Stopped final : public std::exception {
public:
    [[nodiscard]] const char* what() const noexcept override;
};

/// @throws Stopped if the function, called `interrupted` in options, says so; empty or nullptr: never
void stop_if_asked(const std::function<bool()>& interrupted);
inline void stop_if_asked(const std::function<bool()>* interrupted) {
    if (interrupted != nullptr) stop_if_asked(*interrupted);
}

}  // namespace orbid::models

#pragma GCC visibility pop
