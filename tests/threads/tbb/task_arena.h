#pragma once

#include <algorithm>

#include "crew.h"

namespace tbb {

class task_arena {
public:
    explicit task_arena(int limit) { arena_.limit = limit; }

    /// Calls work(); its loops, and the loops in them, have no more threads together than the arena.
    template <class Work>
    decltype(auto) execute(const Work& work) {
        const Return back{detail::current_arena()};
        detail::current_arena() = &arena_;
        return work();
    }

private:
    struct Return {
        detail::Arena* to;
        ~Return() { detail::current_arena() = to; }
    };
    detail::Arena arena_;
};

namespace this_task_arena {

inline int max_concurrency() {
    return std::min(detail::current_arena()->limit, detail::Limits::all().limit());
}

/// A thread that waits for its loop does nothing else here, so nothing needs to be kept apart.
template <class Work>
decltype(auto) isolate(const Work& work) {
    return work();
}

}  // namespace this_task_arena

}  // namespace tbb
