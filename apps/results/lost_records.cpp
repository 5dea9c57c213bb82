#include "apps/results/lost_records.hpp"

#include <algorithm>
#include <cstddef>

#include <fmt/format.h>
#include <fmt/ranges.h>

namespace orbid::apps {

namespace {

constexpr std::size_t most_names = 8;

}  // namespace

bool counts_records(std::string_view residual_type) {
    return residual_type == "series" || residual_type == "waveform";
}

std::string lost_records(const std::vector<estimator::ResidualCount>& counts, const std::vector<SteadyState>& states) {
    std::string out;
    for (const estimator::ResidualCount& count : counts) {
        const std::size_t lost = count.unused.size();
        if (lost == 0 || !counts_records(count.type)) continue;
        const auto shown = count.unused.begin() + static_cast<std::ptrdiff_t>(std::min(lost, most_names));
        out += fmt::format("{}{} of {} records {} not used: {}{}", out.empty() ? "" : "; ", lost,
                           static_cast<std::size_t>(count.used) + lost, lost == 1 ? "is" : "are",
                           fmt::join(count.unused.begin(), shown, "; "), lost > most_names ? "; ..." : "");
    }
    for (const SteadyState& state : states)
        if (!state.used && state.orbit.status == periodic::OrbitStatus::converged)
            out += fmt::format("{}the model has an orbit for {} at the estimate, but it is not used",
                               out.empty() ? "" : "; ", state.segment);
    return out;
}

bool too_few_used(const std::vector<estimator::ResidualCount>& counts) {
    return std::any_of(counts.begin(), counts.end(), [](const estimator::ResidualCount& count) {
        const double all = static_cast<double>(count.used) + static_cast<double>(count.unused.size());
        return counts_records(count.type) && count.used < least_used_share * all;
    });
}

}  // namespace orbid::apps
