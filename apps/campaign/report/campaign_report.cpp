#include "apps/campaign/report/campaign_report.hpp"

#include <algorithm>
#include <array>
#include <exception>
#include <utility>

#include <fmt/chrono.h>
#include <fmt/format.h>

#include "apps/campaign/journal/sqlite.hpp"
#include "apps/campaign/report/campaign_chapters.hpp"
#include "apps/documents/atomic_file.hpp"

namespace orbid::apps {
namespace {

/// "Written 2026-11-24 13:05:07 UTC; renewed every 10 s while tasks wait."
std::string about_page(const CampaignReportOptions& options, bool renewed) {
    std::string words;
    if (!std::isnan(options.written))
        words = fmt::format("Written {:%Y-%m-%d %H:%M:%S} UTC",
                            fmt::gmtime(static_cast<std::time_t>(std::floor(options.written))));
    if (renewed)
        words += fmt::format("{}his page asks for itself anew every {} s while tasks wait", words.empty() ? "T" : "; t",
                             options.refresh_s);
    return words.empty() ? words : words + ".";
}

double unix_time() {
    return std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count();
}

void write_page(const Journal& journal, const std::filesystem::path& file, int refresh_s) {
    write_atomically(file, campaign_report_html(journal, {.written = unix_time(), .refresh_s = refresh_s}));
}

}  // namespace

std::string campaign_report_html(const Journal& journal, const CampaignReportOptions& options) {
    const CampaignFindings findings = campaign_findings(journal, options.interrupted);
    const std::array chapters{settings_chapter(findings), coverage_chapter(findings), dependence_chapter(findings),
                              failure_chapter(findings),  time_chapter(findings),     origin_chapter(findings)};
    const bool renewed = options.refresh_s > 0 && findings.status.counts.waiting > 0;
    const JournalHead& head = journal.head();
    return report_page(
        {.title = head.title.empty() ? std::string("Campaign") : head.title,
         .about = fmt::format("{} · {} · orbid {}", head.kind,
                              detail::grouped_count(static_cast<std::size_t>(head.tasks), "task"), head.version),
         .verdict = campaign_verdict(findings, about_page(options, renewed)),
         .refresh_s = renewed ? options.refresh_s : 0},
        chapters);
}

void write_campaign_report(const Journal& journal, const std::filesystem::path& file) {
    write_page(journal, file, 0);
}

LiveReport::LiveReport(const Journal& journal, std::filesystem::path folder)
    : journal_(journal), file_(std::move(folder) / "report.html"), next_(Clock::now()) {}

LiveReport::~LiveReport() {
    wait();
}

void LiveReport::wait() const {
    if (writing_.valid()) writing_.wait();
}

void LiveReport::renew() {
    const auto now = Clock::now();
    if (writing_.valid()) {
        if (writing_.wait_for(std::chrono::seconds(0)) != std::future_status::ready) return;
        next_ = std::max(begun_ + shortest, now + 20 * (now - begun_));
        try {
            writing_.get();
        } catch (const std::exception&) {
            // The disk may be full, or the journal not be readable just now: the campaign goes on.
        }
    }
    if (now < next_) return;
    begun_ = now;
    writing_ = std::async(std::launch::async, [path = journal_.database().path(), file = file_] {
        const Journal reader = Journal::open(path, Journal::Access::read);
        write_page(reader, file, static_cast<int>(shortest.count()));
    });
}

void LiveReport::finish() {
    wait();
    writing_ = {};
    write_page(journal_, file_, 0);
}

}  // namespace orbid::apps
