#include "models/system/stopped.hpp"

namespace orbid::models {

const char* Stopped::what() const noexcept {
    return "stopped by the caller";
}

void stop_if_asked(const std::function<bool()>& interrupted) {
    if (interrupted && interrupted()) throw Stopped();
}

}  // namespace orbid::models
