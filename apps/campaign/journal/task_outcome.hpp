#pragma once

#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <vector>

namespace orbid::apps {

/// waiting: not run yet, or to be run again. done: its run ended with a result, valid or not, as its status says.
/// failed: there is no result: an invalid job, unusable data, a crash, a limit.
enum class TaskState { waiting, done, failed };

/// One task of a campaign before it is run.
struct TaskPlan {
    std::int64_t number = 0;          ///< from 0, in the order of the campaign
    std::string key;                  ///< SHA-256 of its job, in hexadecimal digits
    std::vector<std::string> values;  ///< of what varies, as JSON text; one for each VariedColumn
    std::optional<std::int64_t> seed = {};
};

/// An estimated number of a task: a parameter of the model or of the errors.
struct TaskParameter {
    static constexpr double unknown = std::numeric_limits<double>::quiet_NaN();
    std::string name;
    double value = unknown;
    double sd = unknown;
    double lower = unknown;  ///< of the interval
    double upper = unknown;
    double truth = unknown;  ///< value that made the data
    double bound = unknown;  ///< least sd that any estimate can have (information at the truth)
};

/// What a task gave.
struct TaskOutcome {
    std::int64_t number = 0;
    TaskState state = TaskState::done;
    int exit_code = 0;
    std::string
        status;  ///< of the estimate; of a failed task one word: "invalid", "data", "crash", "time_limit", "error"
    std::string message;  ///< one line
    double objective = TaskParameter::unknown;
    std::vector<TaskParameter> parameters;
    std::string result;            ///< result.json, compressed by zlib; empty: none
    double started = 0;            ///< Unix time, in s
    double seconds = 0;            ///< of the clock
    double processor_seconds = 0;  ///< of the thread that ran it
    std::string host;
    int rank = 0;
};

}  // namespace orbid::apps
