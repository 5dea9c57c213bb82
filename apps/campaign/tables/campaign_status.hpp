#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "apps/campaign/journal/journal.hpp"

namespace orbid::apps {

/// Why tasks failed, or gave no valid answer: those of one status and, but for numbers and quoted names, one message.
struct FailureReason {
    TaskState state = TaskState::failed;
    std::string status;
    std::string message;  ///< that of the first of these tasks
    std::int64_t count = 0;
    std::vector<std::int64_t> tasks;  ///< numbers of the first ones, at most `most_named`

    static constexpr std::size_t most_named = 12;
};

/// Where a campaign stands.
struct CampaignStatus {
    struct Status {
        TaskState state = TaskState::done;
        std::string status;
        std::int64_t count = 0;
    };
    JournalCounts counts;
    std::vector<Status> statuses;  ///< of tasks that ended, the most frequent first
    std::vector<FailureReason>
        reasons;                 ///< of tasks that failed or have an exit code other than 0; most frequent first
    std::int64_t intervals = 0;  ///< of valid tasks, with a truth
    std::int64_t covered = 0;    ///< of them, those that hold it
    double first_start = 0;      ///< Unix time of the first task, in s; nan: none has run
    double last_end = 0;         ///< of the last one
};

/// Reads what the journal says of all tasks that ended, without the checksum of each row: under a second for 10^6.
[[nodiscard]] CampaignStatus read_campaign_status(const Journal& journal);

/// What `orbid campaign status` prints.
[[nodiscard]] std::string campaign_status(const Journal& journal);

/// The same of what was read. @param most_reasons  that are listed.
[[nodiscard]] std::string status_text(const JournalHead& head, const CampaignStatus& status,
                                      std::size_t most_reasons = 10);

/// "time: ..." of what ended, one sentence.
[[nodiscard]] std::string time_words(const CampaignStatus& status);

/// A message without what differs between tasks: numbers become "#", what stands in quotes "...".
[[nodiscard]] std::string message_pattern(const std::string& message);

}  // namespace orbid::apps
