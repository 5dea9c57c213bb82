#pragma once

#include <chrono>
#include <string>

#include "apps/campaign/engine/dealer.hpp"
#include "apps/program/console.hpp"

namespace orbid::apps {

/// How far a campaign is, on standard error: a line that is rewritten on a terminal, elsewhere one every so often. No
/// thread of its own: processes are forked beside it.
class CampaignProgressLine {
public:
    CampaignProgressLine(const Console& console, bool quiet, std::chrono::milliseconds every);
    /// Ends a line that is rewritten.
    ~CampaignProgressLine();
    CampaignProgressLine(const CampaignProgressLine&) = delete;
    CampaignProgressLine& operator=(const CampaignProgressLine&) = delete;

    void show(const CampaignProgress& progress);

private:
    const Console& console_;
    bool quiet_;
    bool terminal_;
    std::chrono::milliseconds every_;
    std::chrono::steady_clock::time_point shown_;
    bool open_ = false;
};

/// "1 204 of 10 000 done, 3 failed, 64 in work; about 12 min left"
[[nodiscard]] std::string progress_text(const CampaignProgress& progress);

}  // namespace orbid::apps
