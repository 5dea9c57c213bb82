#pragma once

#include <mutex>
#include <unordered_map>
#include <utility>

#include "crew.h"

namespace tbb {

/// Finding and adding by several threads at once; nothing is ever taken out, so entries stay where they are.
template <class Key, class Value>
class concurrent_unordered_map {
    using Map = std::unordered_map<Key, Value>;

public:
    using iterator = typename Map::iterator;

    iterator find(const Key& key) {
        const std::lock_guard lock(mutex_);
        return map_.find(key);
    }
    template <class... Parts>
    std::pair<iterator, bool> emplace(Parts&&... parts) {
        const std::lock_guard lock(mutex_);
        return map_.emplace(std::forward<Parts>(parts)...);
    }
    /// The end does not move when entries are added.
    iterator end() { return map_.end(); }

private:
    std::mutex mutex_;
    Map map_;
};

}  // namespace tbb
