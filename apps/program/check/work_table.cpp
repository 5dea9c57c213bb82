#include <cmath>

#include <fmt/format.h>

#include "apps/program/check/work_estimate.hpp"
#include "apps/results/summary_table.hpp"
#include "apps/stages/progress.hpp"

namespace orbid::apps {

namespace {

/// One digit: more would promise too much.
std::string rough(double seconds) {
    if (!(seconds >= 0.1)) return "< 0.1 s";
    const double unit = std::pow(10.0, std::floor(std::log10(seconds)));
    return duration_text(std::round(seconds / unit) * unit);
}

}  // namespace

std::string work_table(const std::vector<StageWork>& work, int threads) {
    if (work.empty()) return {};
    SummaryTable table({left_aligned("stage"), left_aligned("amount"), "memory", "about"});
    double seconds = 0.0;
    std::string reasons;
    for (const StageWork& stage : work) {
        const bool known = stage.unknown.empty();
        if (known)
            seconds += stage.seconds;
        else
            reasons += fmt::format("  {}: {}\n", stage.stage, stage.unknown);
        table.add({stage.stage, stage.amount,
                   stage.megabytes < 0.1 ? std::string() : fmt::format("{:.3g} MB", stage.megabytes),
                   known ? rough(stage.seconds) : "unknown"});
    }
    return fmt::format("\nWork with {} thread{}, to a factor of three: {}{}\n{}{}", threads, threads == 1 ? "" : "s",
                       reasons.empty() ? "" : "unknown, and ", rough(seconds), table.text(),
                       reasons.empty() ? "" : "Unknown\n" + reasons);
}

}  // namespace orbid::apps
