#pragma once

#include <cstddef>

#include "crew.h"

namespace tbb {

/// [begin, end) in pieces of at most `grainsize`, where a loop makes them so small.
template <class Value>
class blocked_range {
public:
    using const_iterator = Value;
    using size_type = std::size_t;

    blocked_range(Value begin, Value end, size_type grainsize = 1) : begin_(begin), end_(end), grainsize_(grainsize) {}
    [[nodiscard]] Value begin() const { return begin_; }
    [[nodiscard]] Value end() const { return end_; }
    [[nodiscard]] size_type size() const { return empty() ? 0 : static_cast<size_type>(end_ - begin_); }
    [[nodiscard]] size_type grainsize() const { return grainsize_; }
    [[nodiscard]] bool empty() const { return !(begin_ < end_); }

private:
    Value begin_, end_;
    size_type grainsize_;
};

}  // namespace tbb
