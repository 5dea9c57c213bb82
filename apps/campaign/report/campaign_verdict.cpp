#include <cmath>

#include <fmt/format.h>

#include "apps/campaign/report/campaign_chapters.hpp"
#include "apps/drawing/chart.hpp"
#include "apps/report/html_text.hpp"

namespace orbid::apps {
namespace {

std::string verdict_count(std::int64_t count, std::string_view noun = "task") {
    return detail::grouped_count(static_cast<std::size_t>(count), noun);
}

std::string share_words(std::int64_t part, std::int64_t whole) {
    return fmt::format("{:.3g} %", 100.0 * static_cast<double>(part) / static_cast<double>(whole));
}

/// Of all parameters together a nominal coverage is doubted by mistake once in twenty campaigns.
void add_coverage(const CampaignFindings& findings, ReportRemarks& remarks) {
    const auto& names = findings.groups.names();
    std::size_t known = 0;
    for (std::size_t k = 0; k < names.size(); ++k)
        known += findings.groups.all().parameter(k).intervals > 0;
    std::string right;
    for (std::size_t k = 0; k < names.size(); ++k) {
        const ParameterStatistics& statistics = findings.groups.all().parameter(k);
        if (statistics.intervals == 0) continue;
        const auto interval =
            binomial_interval(statistics.covered, statistics.intervals, 1 - 0.05 / static_cast<double>(known));
        const std::string words = fmt::format("{} in {:.1f} % of {}", names[k], 100 * statistics.coverage(),
                                              verdict_count(statistics.intervals));
        if (interval.upper < interval_level)
            remarks.caution(
                fmt::format("The 95 % intervals hold the truth of {}: too few; they are too narrow or off.", words));
        else if (interval.lower > interval_level)
            remarks.caution(
                fmt::format("The 95 % intervals hold the truth of {}: more than they say; they are wide.", words));
        else
            append_words(right, words, "; ");
    }
    if (!right.empty()) remarks.good("The 95 % intervals hold the truth as often as they say: " + right + ".");
}

}  // namespace

std::string campaign_verdict(const CampaignFindings& findings, const std::string& written) {
    const CampaignStatus& status = findings.status;
    const GroupStatistics& all = findings.groups.all();
    const std::int64_t tasks = findings.head->tasks;
    const std::int64_t ended = status.counts.done + status.counts.failed;
    std::string summary =
        ended == 0 ? fmt::format("None of {} has ended yet.", verdict_count(tasks))
                   : fmt::format("{} of {} done", detail::grouped(static_cast<std::size_t>(status.counts.done)),
                                 verdict_count(tasks));
    if (ended > 0) {
        if (status.intervals > 0)
            summary +=
                fmt::format("; {} of their intervals hold the truth", share_words(status.covered, status.intervals));
        summary += status.counts.failed > 0 ? fmt::format("; {} failed", share_words(status.counts.failed, ended))
                                            : std::string("; none failed");
        if (status.counts.waiting > 0) summary += fmt::format("; {} to go", verdict_count(status.counts.waiting));
        summary += ".";
    }
    if (!written.empty()) summary += " " + written;
    ReportRemarks remarks;
    if (ended > 0 && all.valid == 0)
        remarks.bad("No task has a valid answer.");
    else if (all.valid < all.done)
        remarks.caution(fmt::format("{} ended without a valid answer, {} of those done.",
                                    verdict_count(all.done - all.valid), share_words(all.done - all.valid, all.done)));
    else if (all.done > 0)
        remarks.good("All tasks that are done have valid answers.");
    std::size_t named = 0;
    for (const FailureReason& reason : status.reasons) {
        if (reason.state != TaskState::failed || named++ == 3) continue;
        remarks.caution(fmt::format("{} failed ({}): {}", verdict_count(reason.count), reason.status, reason.message));
    }
    add_coverage(findings, remarks);
    return verdict_section(summary, remarks.html());
}

}  // namespace orbid::apps
