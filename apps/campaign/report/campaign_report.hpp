#pragma once

#include <chrono>
#include <cmath>
#include <filesystem>
#include <functional>
#include <future>
#include <string>

#include "apps/campaign/journal/journal.hpp"

namespace orbid::apps {

struct CampaignReportOptions {
    double written = std::nan("");  ///< Unix time, in s, that the page gives for itself; nan: none
    int refresh_s = 0;              ///< while tasks wait the page asks for itself again after so many seconds; 0: never
    /// Asked all along; stops with models::Stopped when it says so.
    std::function<bool()> interrupted = {};
};

/// One self-contained page of HTML about a campaign, whatever its kind and however far it is, from its journal alone.
/// The same journal and options give the same bytes.
/// @throws JournalError
[[nodiscard]] std::string campaign_report_html(const Journal& journal, const CampaignReportOptions& options = {});

/// Writes the page whole or not at all, with the time of writing while tasks wait.
/// @throws JournalError; std::runtime_error when the file cannot be written.
void write_campaign_report(const Journal& journal, const std::filesystem::path& file);

/// report.html of a campaign that runs: written anew at intervals, by a thread with a reader of its own.
class LiveReport {
public:
    /// @param journal  whose file is read; it is not used otherwise until finish().
    /// @param folder   of report.html.
    LiveReport(const Journal& journal, std::filesystem::path folder);
    /// Waits for the writing that is under way.
    ~LiveReport();
    LiveReport(const LiveReport&) = delete;
    LiveReport& operator=(const LiveReport&) = delete;

    /// Begins to write if it is time to: 10 s after the last time at the earliest, and so that writing takes a
    /// twentieth of the time at most. A page that cannot be written is left for the next time.
    void renew();
    /// Waits for the writing that is under way: afterwards there is no thread of the report.
    void wait() const;
    /// Writes the last state, from the journal given.
    /// @throws JournalError; std::runtime_error when the file cannot be written.
    void finish();

private:
    using Clock = std::chrono::steady_clock;
    static constexpr std::chrono::seconds shortest{10};

    const Journal& journal_;
    std::filesystem::path file_;
    std::future<void> writing_;
    Clock::time_point begun_;
    Clock::time_point next_;
};

}  // namespace orbid::apps
