#include "apps/campaign/tables/campaign_status.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <tuple>

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

/// Equal messages are counted by SQL, those that differ by numbers and names here.
std::vector<FailureReason> failure_reasons(const SqliteFile& file) {
    std::map<std::tuple<TaskState, std::string, std::string>, FailureReason> reasons;
    Statement rows(file,
                   "SELECT state, status, message, count(*), min(task) FROM outcome WHERE state = 'failed' OR "
                   "(state = 'done' AND exit_code <> 0) GROUP BY state, status, message");
    while (rows.step()) {
        FailureReason one{state_from_name(rows.bytes(0)), rows.text(1), rows.text(2), rows.integer(3), rows.integer(4)};
        const auto [found, added] = reasons.try_emplace({one.state, one.status, message_pattern(one.message)}, one);
        if (added) continue;
        FailureReason& known = found->second;
        known.count += one.count;
        if (one.first < known.first) {
            known.first = one.first;
            known.message = one.message;
        }
    }
    std::vector<FailureReason> out;
    for (auto& [key, reason] : reasons)
        out.push_back(std::move(reason));
    std::sort(out.begin(), out.end(), [](const auto& a, const auto& b) {
        return std::make_pair(-a.count, a.first) < std::make_pair(-b.count, b.first);
    });
    return out;
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

CampaignStatus campaign_status(const Journal& journal) {
    const SqliteFile& file = journal.database();
    CampaignStatus out;
    out.counts = journal.counts();
    Statement statuses(file,
                       "SELECT state, status, count(*), min(started), max(started + seconds), "
                       "sum(CASE WHEN exit_code = 0 THEN intervals END), sum(CASE WHEN exit_code = 0 THEN covered END) "
                       "FROM outcome WHERE state <> 'waiting' GROUP BY state, status");
    out.first_start = std::nan("");
    out.last_end = std::nan("");
    while (statuses.step()) {
        const TaskState state = state_from_name(statuses.bytes(0));
        out.statuses.push_back({state, statuses.text(1), statuses.integer(2)});
        out.first_start = std::fmin(out.first_start, statuses.real(3));
        out.last_end = std::fmax(out.last_end, statuses.real(4));
        if (state != TaskState::done) continue;
        out.intervals += statuses.integer(5);
        out.covered += statuses.integer(6);
    }
    std::sort(out.statuses.begin(), out.statuses.end(), [](const auto& a, const auto& b) {
        return std::tie(b.count, a.state, a.status) < std::tie(a.count, b.state, b.status);
    });
    out.reasons = failure_reasons(file);
    return out;
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
    out +=
        fmt::format("time: {} of all tasks, {} of processors, {} per task; from the first start to the last end {}\n",
                    duration_words(counts.seconds), duration_words(counts.processor_seconds),
                    duration_words(counts.seconds / static_cast<double>(ended)),
                    duration_words(status.last_end - status.first_start));
    if (status.reasons.empty()) return out;
    SummaryTable reasons({left_aligned("why not"), left_aligned("message"), "tasks", "first"});
    for (std::size_t k = 0; k < std::min(most_reasons, status.reasons.size()); ++k) {
        const FailureReason& reason = status.reasons[k];
        reasons.add({reason.status, reason.message, grouped_digits(static_cast<std::size_t>(reason.count)),
                     std::to_string(reason.first)});
    }
    out += reasons.text();
    if (status.reasons.size() > most_reasons)
        out += fmt::format("  and {} more\n",
                           count_words(static_cast<std::int64_t>(status.reasons.size() - most_reasons), "reason"));
    return out;
}

}  // namespace orbid::apps
