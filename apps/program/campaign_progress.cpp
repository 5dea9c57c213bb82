#include "apps/program/campaign_progress.hpp"

#include <unistd.h>

#include <cmath>
#include <ostream>

#include <fmt/format.h>

namespace orbid::apps {

namespace {

std::string duration(double seconds) {
    constexpr double minute = 60.0, hour = 3600.0, day = 86400.0;
    if (seconds < 2.0 * minute) return fmt::format("{:.0f} s", std::ceil(seconds));
    if (seconds < 2.0 * hour) return fmt::format("{:.0f} min", seconds / minute);
    if (seconds < 2.0 * day) return fmt::format("{:.1f} h", seconds / hour);
    return fmt::format("{:.1f} days", seconds / day);
}

}  // namespace

std::string progress_text(const CampaignProgress& progress) {
    std::string text = fmt::format("{} of {} done", progress.done, progress.tasks);
    if (progress.failed > 0) text += fmt::format(", {} failed", progress.failed);
    if (progress.in_work > 0) text += fmt::format(", {} in work", progress.in_work);
    if (progress.done + progress.failed < progress.tasks)
        text += std::isnan(progress.remaining) ? "; no task has ended yet"
                                               : fmt::format("; about {} left", duration(progress.remaining));
    return text;
}

CampaignProgressLine::CampaignProgressLine(const Console& console, bool quiet, std::chrono::milliseconds every)
    : console_(console),
      quiet_(quiet),
      terminal_(console.error_terminal != nullptr && ::isatty(::fileno(console.error_terminal)) != 0),
      every_(terminal_ ? std::chrono::milliseconds(500) : every),
      shown_(std::chrono::steady_clock::now() - (terminal_ ? every_ : every_ * 4 / 5)) {}

CampaignProgressLine::~CampaignProgressLine() {
    if (open_) console_.error << '\n' << std::flush;
}

void CampaignProgressLine::show(const CampaignProgress& progress) {
    const auto now = std::chrono::steady_clock::now();
    if (quiet_ || now - shown_ < every_) return;
    shown_ = now;
    if (terminal_)
        console_.error << "\r\x1b[K" << progress_text(progress) << std::flush;
    else
        console_.error << progress_text(progress) << '\n' << std::flush;
    open_ = terminal_;
}

}  // namespace orbid::apps
