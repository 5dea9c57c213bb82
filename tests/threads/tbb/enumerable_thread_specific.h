#pragma once

#include <map>
#include <mutex>
#include <thread>
#include <utility>

#include "crew.h"

namespace tbb {

/// A copy of a value per thread that asked for it. Going through them is for one thread, after the loop.
template <class T>
class enumerable_thread_specific {
    using Copies = std::map<std::thread::id, T>;

public:
    explicit enumerable_thread_specific(const T& value) : value_(value) {}

    T& local() {
        const std::lock_guard lock(mutex_);
        return copies_.try_emplace(std::this_thread::get_id(), value_).first->second;
    }

    class iterator {
    public:
        explicit iterator(typename Copies::iterator at) : at_(at) {}
        T& operator*() const { return at_->second; }
        iterator& operator++() {
            ++at_;
            return *this;
        }
        bool operator!=(const iterator& other) const { return at_ != other.at_; }

    private:
        typename Copies::iterator at_;
    };
    [[nodiscard]] iterator begin() { return iterator(copies_.begin()); }
    [[nodiscard]] iterator end() { return iterator(copies_.end()); }

private:
    T value_;
    std::mutex mutex_;
    Copies copies_;
};

}  // namespace tbb
