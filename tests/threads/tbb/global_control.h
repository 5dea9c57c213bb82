#pragma once

#include <cstddef>

#include "crew.h"

namespace tbb {

/// While it lives no loop has more threads; of several the least holds.
class global_control {
public:
    enum parameter { max_allowed_parallelism };

    global_control(parameter /*kind*/, std::size_t value) : value_(value) { detail::Limits::all().add(value); }
    ~global_control() { detail::Limits::all().remove(value_); }
    global_control(const global_control&) = delete;
    global_control& operator=(const global_control&) = delete;

    [[nodiscard]] static std::size_t active_value(parameter /*kind*/) {
        return static_cast<std::size_t>(detail::Limits::all().limit());
    }

private:
    std::size_t value_;
};

}  // namespace tbb
