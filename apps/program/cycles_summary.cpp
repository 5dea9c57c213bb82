#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

#include <fmt/format.h>

#include "apps/program/summary.hpp"
#include "apps/results/summary_table.hpp"

namespace orbid::apps {

namespace {

/// ": " and the reason, where the search has noted one.
std::string why_missing(const orbits::CycleSearch& search, int period) {
    const std::string before = fmt::format("no cycle of period {} was found:", period);
    for (const std::string& remark : search.remarks)
        if (remark.starts_with(before)) return remark.substr(before.size() - 1);
    return {};
}

}  // namespace

std::string cycles_summary(const orbits::CycleSearch& search) {
    struct Row {
        std::size_t cycles = 0;
        std::size_t fewest = std::numeric_limits<std::size_t>::max();
        std::size_t most = 0;
        double worst_sd = 0.0;
        double least = std::numeric_limits<double>::infinity();  ///< unstable |multiplier|
        double largest = 0.0;
    };
    std::map<int, Row> rows;
    for (const auto& cycle : search.cycles) {
        Row& row = rows[cycle.period];
        ++row.cycles;
        row.fewest = std::min(row.fewest, cycle.recurrences);
        row.most = std::max(row.most, cycle.recurrences);
        if (cycle.covariance.size() > 0)
            row.worst_sd = std::max(row.worst_sd, std::sqrt(cycle.covariance.diagonal().maxCoeff()));
        if (!cycle.multipliers.empty()) {
            row.least = std::min(row.least, std::abs(cycle.multipliers.front()));
            row.largest = std::max(row.largest, std::abs(cycle.multipliers.front()));
        }
    }
    SummaryTable table({"period", "cycles", "points", "recurrences", "largest |multiplier|", "worst sd of a point"});
    for (const auto& [period, row] : rows)
        table.add({std::to_string(period), std::to_string(row.cycles),
                   std::to_string(row.cycles * static_cast<std::size_t>(period)),
                   fmt::format("{} ... {}", row.fewest, row.most),
                   row.largest > 0.0 ? fmt::format("{:.3g} ... {:.3g}", row.least, row.largest) : "",
                   row.worst_sd > 0.0 ? significant(row.worst_sd, 2) : ""});
    std::string out = titled("Unstable periodic orbits in the series", table.text());
    for (const int period : search.missing)
        out += fmt::format("  period {}: none found{}\n", period, why_missing(search, period));
    // How near the record comes to itself, and what it can be used for instead.
    for (const std::string& remark : search.remarks)
        if (search.cycles.empty() && !remark.starts_with("no cycle of period ")) out += fmt::format("  {}\n", remark);
    return out;
}

}  // namespace orbid::apps
