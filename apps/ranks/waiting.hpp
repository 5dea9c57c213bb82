#pragma once

#include <algorithm>
#include <chrono>
#include <limits>

namespace orbid::apps {

/// What is left of a patience, as poll(2) takes it.
class Waiting {
public:
    /// At most 24 days.
    explicit Waiting(std::chrono::milliseconds patience)
        : end_(std::chrono::steady_clock::now() + std::min(patience, longest)) {}
    /// In milliseconds, rounded up; 0 when it has passed.
    [[nodiscard]] int left() const {
        const auto left = std::chrono::ceil<std::chrono::milliseconds>(end_ - std::chrono::steady_clock::now());
        return static_cast<int>(std::clamp(left, std::chrono::milliseconds(0), longest).count());
    }

private:
    static constexpr std::chrono::milliseconds longest{std::numeric_limits<int>::max()};

    std::chrono::steady_clock::time_point end_;
};

}  // namespace orbid::apps
