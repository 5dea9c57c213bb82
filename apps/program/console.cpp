#include "apps/program/console.hpp"

#include <cstddef>
#include <iostream>

#include <tbb/global_control.h>
#include <tbb/task_arena.h>

namespace orbid::apps {

Console standard_console(bool own_process) {
    return {std::cout, std::cerr, stdout, stderr, true, own_process};
}

int with_thread_limit(int threads, const Console& console, const std::function<int()>& compute) {
    if (threads <= 0) return compute();
    if (console.own_process || console.signals) {
        const tbb::global_control limit(tbb::global_control::max_allowed_parallelism,
                                        static_cast<std::size_t>(threads));
        return compute();
    }
    return tbb::task_arena(threads).execute(compute);
}

}  // namespace orbid::apps
