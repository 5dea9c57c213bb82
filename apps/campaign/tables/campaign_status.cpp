#include "apps/campaign/tables/campaign_status.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <tuple>
#include <unordered_map>

#include <fmt/format.h>

#include "apps/campaign/journal/journal_tables.hpp"
#include "apps/campaign/tables/binomial_interval.hpp"
#include "apps/drawing/chart.hpp"
#include "apps/results/counted_noun.hpp"
#include "apps/results/summary_table.hpp"

namespace orbid::apps {
namespace {

std::string count_words(std::int64_t count, std::string_view noun) {
    const auto number = static_cast<std::size_t>(count);
    return counted(number, noun, grouped_digits(number));
}

bool digit(char c) {
    return c >= '0' && c <= '9';
}

/// "3 h 20 min", "4.2 s"
std::string duration_words(double seconds) {
    if (seconds < 120) return fmt::format("{:.3g} s", seconds);
    if (seconds < 7200) return fmt::format("{:.0f} min", seconds / 60);
    if (seconds < 172800)
        return fmt::format("{:.0f} h {:02.0f} min", std::floor(seconds / 3600),
                           std::floor(std::fmod(seconds, 3600) / 60));
    return fmt::format("{:.1f} days", seconds / 86400);
}

/// Gathers reasons, a task at a time.
class FailureReasons {
public:
    void add(TaskState state, std::string_view status, std::string_view message, std::int64_t task) {
        // Mostly the messages of a campaign are few: those that were seen need no pattern.
        key_.assign(state_name(state)).append("\n").append(status).append("\n").append(message);
        auto known = numbers_.find(key_);
        std::size_t number = 0;
        if (known != numbers_.end()) {
            number = known->second;
        } else {
            const auto [place, added] = patterns_.try_emplace(
                {state, std::string(status), message_pattern(std::string(message))}, list_.size());
            number = place->second;
            if (added) list_.push_back({state, std::string(status), std::string(message), 0, {}});
            if (numbers_.size() < most_known) numbers_.emplace(key_, number);
        }
        FailureReason& reason = list_[number];
        ++reason.count;
        if (reason.tasks.size() < FailureReason::most_named) reason.tasks.push_back(task);
    }
    /// The most frequent first.
    [[nodiscard]] std::vector<FailureReason> sorted() && {
        std::sort(list_.begin(), list_.end(), [](const auto& a, const auto& b) {
            return std::make_pair(-a.count, a.tasks.front()) < std::make_pair(-b.count, b.tasks.front());
        });
        return std::move(list_);
    }

private:
    static constexpr std::size_t most_known = 10000;
    std::string key_;
    std::unordered_map<std::string, std::size_t> numbers_;
    std::map<std::tuple<TaskState, std::string, std::string>, std::size_t> patterns_;
    std::vector<FailureReason> list_;
};

/// The entry of a state and a status, of which there are few.
CampaignStatus::Status& entry_of(std::vector<CampaignStatus::Status>& list, TaskState state, std::string_view status) {
    for (auto& one : list)
        if (one.state == state && one.status == status) return one;
    return list.emplace_back(CampaignStatus::Status{state, std::string(status), 0});
}

}  // namespace

std::string message_pattern(const std::string& message) {
    std::string out;
    for (std::size_t k = 0; k < message.size();) {
        const char c = message[k];
        if (c == '"') {
            const auto end = message.find('"', k + 1);
            out += "\"\"";
            k = end == std::string::npos ? message.size() : end + 1;
        } else if (digit(c)) {
            while (k < message.size() && (digit(message[k]) || message[k] == '.' || message[k] == 'e' ||
                                          (message[k] == '-' && message[k - 1] == 'e')))
                ++k;
            out += '#';
        } else {
            out += c;
            ++k;
        }
    }
    return out;
}

CampaignStatus read_campaign_status(const Journal& journal) {
    CampaignStatus out;
    out.first_start = std::nan("");
    out.last_end = std::nan("");
    FailureReasons reasons;
    // One scan in the order of tasks: grouping by SQL would sort all of them.
    Statement rows(journal.database(),
                   "SELECT state, status, exit_code, started, seconds, processor_seconds, intervals, covered, task, "
                   "CASE WHEN exit_code <> 0 OR state = 'failed' THEN message END FROM outcome WHERE state <> "
                   "'waiting' ORDER BY task");
    while (rows.step()) {
        const TaskState state = state_from_name(rows.bytes(0));
        const bool valid = state == TaskState::done && rows.integer(2) == 0;
        ++entry_of(out.statuses, state, rows.bytes(1)).count;
        ++(state == TaskState::done ? out.counts.done : out.counts.failed);
        out.counts.seconds += rows.real(4);
        out.counts.processor_seconds += rows.real(5);
        out.first_start = std::fmin(out.first_start, rows.real(3));
        out.last_end = std::fmax(out.last_end, rows.real(3) + rows.real(4));
        if (valid) {
            out.intervals += rows.integer(6);
            out.covered += rows.integer(7);
        } else {
            reasons.add(state, rows.bytes(1), rows.bytes(9), rows.integer(8));
        }
    }
    out.counts.waiting = journal.head().tasks - out.counts.done - out.counts.failed;
    std::sort(out.statuses.begin(), out.statuses.end(), [](const auto& a, const auto& b) {
        return std::tie(b.count, a.state, a.status) < std::tie(a.count, b.state, b.status);
    });
    out.reasons = std::move(reasons).sorted();
    return out;
}

std::string time_words(const CampaignStatus& status) {
    const auto ended = static_cast<double>(status.counts.done + status.counts.failed);
    return fmt::format("{} of all tasks, {} of processors, {} per task; from the first start to the last end {}",
                       duration_words(status.counts.seconds), duration_words(status.counts.processor_seconds),
                       duration_words(status.counts.seconds / ended),
                       duration_words(status.last_end - status.first_start));
}

std::string campaign_status(const Journal& journal) {
    return status_text(journal.head(), read_campaign_status(journal));
}

std::string status_text(const JournalHead& head, const CampaignStatus& status, std::size_t most_reasons) {
    const JournalCounts& counts = status.counts;
    const std::int64_t ended = counts.done + counts.failed;
    std::string out;
    if (!head.title.empty()) out += head.title + "\n";
    out += fmt::format("{}: {}, {} done, {} failed, {} waiting\n", head.kind, count_words(head.tasks, "task"),
                       grouped_digits(static_cast<std::size_t>(counts.done)),
                       grouped_digits(static_cast<std::size_t>(counts.failed)),
                       grouped_digits(static_cast<std::size_t>(counts.waiting)));
    if (ended == 0) return out;
    SummaryTable statuses({left_aligned("state"), left_aligned("status"), "tasks"});
    for (const auto& one : status.statuses)
        statuses.add(
            {std::string(state_name(one.state)), one.status, grouped_digits(static_cast<std::size_t>(one.count))});
    out += statuses.text();
    if (status.intervals > 0) {
        const auto interval = binomial_interval(status.covered, status.intervals);
        out += fmt::format(
            "coverage: {} of {} intervals hold the truth, {:.1f} % (95 % interval {:.1f} to {:.1f} %; "
            "nominal {:.0f} %)\n",
            grouped_digits(static_cast<std::size_t>(status.covered)),
            grouped_digits(static_cast<std::size_t>(status.intervals)),
            100.0 * static_cast<double>(status.covered) / static_cast<double>(status.intervals), 100.0 * interval.lower,
            100.0 * interval.upper, 100.0 * interval_level);
    }
    out += "time: " + time_words(status) + "\n";
    if (status.reasons.empty()) return out;
    SummaryTable reasons({left_aligned("why not"), left_aligned("message"), "tasks", "first"});
    for (std::size_t k = 0; k < std::min(most_reasons, status.reasons.size()); ++k) {
        const FailureReason& reason = status.reasons[k];
        reasons.add({reason.status, reason.message, grouped_digits(static_cast<std::size_t>(reason.count)),
                     std::to_string(reason.tasks.front())});
    }
    out += reasons.text();
    if (status.reasons.size() > most_reasons)
        out += fmt::format("  and {} more\n",
                           count_words(static_cast<std::int64_t>(status.reasons.size() - most_reasons), "reason"));
    return out;
}

}  // namespace orbid::apps
