#pragma once

#include <chrono>
#include <filesystem>

namespace orbid::apps {

/// Which stages of a job are run: all it names, or one.
enum class Stage { all, simulate, orbits, periodic, estimate };

/// How a job is run.
struct RunOptions {
    std::filesystem::path out;  ///< folder of the result files; not used in memory
    int threads = 0;            ///< 0 = all cores
    bool quiet = false;         ///< no progress
    bool force = false;         ///< overwrite a folder that holds the result of another job
    Stage stage = Stage::all;
    bool in_memory = false;                           ///< no folder: only the content of result.json is kept
    std::chrono::milliseconds progress_every{10000};  ///< longest time between lines where there is no terminal
};

}  // namespace orbid::apps
