#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "apps/campaign/journal/task_outcome.hpp"

namespace orbid::apps {

/// What rank 0 and those that compute say to each other. Numbers are in the byte order of the machine: all ranks run
/// the same program.
struct TaskMessage {
    enum class Kind : std::uint8_t {
        campaign,  ///< rank 0, first: what the campaign is
        task,      ///< rank 0: run it
        stop,      ///< rank 0: leave what is in work, and end
        outcome,   ///< to rank 0: of the task that was dealt first
        refusal    ///< to rank 0: the campaign cannot be taken up; `text` says why
    };
    Kind kind = Kind::stop;
    std::int64_t number = 0;
    std::string text;  ///< the campaign's document
    TaskOutcome outcome;
};

[[nodiscard]] std::vector<std::byte> packed(const TaskMessage& message);
/// @throws std::runtime_error for bytes that are no message.
[[nodiscard]] TaskMessage unpacked(std::span<const std::byte> bytes);

}  // namespace orbid::apps
