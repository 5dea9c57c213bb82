#pragma once

#include <cstdio>
#include <string>

namespace orbid::bench {

/// One row of docs/performance.md, which run.py collects from what benchmarks print. Both do the same task, in the same
/// run: to equal error, or to the same result.
/// @param ours, theirs  times, in any unit that both share; less is better.
inline void print_ratio(const std::string& task, const std::string& peer, double ours, double theirs,
                        const std::string& unit) {
    std::printf("ratio | %s | %s | %.4g %s | %.4g %s | %.3f\n", task.c_str(), peer.c_str(), ours, unit.c_str(), theirs,
                unit.c_str(), ours / theirs);
}

}  // namespace orbid::bench
