#include "apps/results/periodic_summary.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <map>

#include <fmt/format.h>

#include "apps/results/counted_noun.hpp"
#include "apps/results/summary_table.hpp"

namespace orbid::apps {

namespace {

std::string multipliers_text(const std::vector<std::complex<double>>& multipliers) {
    // More do not fit into a line; the file has them all.
    constexpr std::size_t most = 4;
    std::string text;
    for (std::size_t m = 0; m < std::min(most, multipliers.size()); ++m) {
        text += fmt::format("{}{:.6g}", m == 0 ? "" : ", ", multipliers[m].real());
        text += multipliers[m].imag() == 0.0 ? "" : fmt::format("{:+.6g}i", multipliers[m].imag());
    }
    return multipliers.size() > most ? text + ", ..." : text;
}

std::string starts_table(const ComputedOrbits& orbits) {
    SummaryTable table({"orbit", "period", left_aligned("rotation"), "time [s]", left_aligned("status"),
                        left_aligned("first point"), left_aligned("multipliers"), "unstable", left_aligned("near"),
                        "closing error"});
    for (std::size_t i = 0; i < orbits.list.size(); ++i) {
        const ComputedOrbit& computed = orbits.list[i];
        if (computed.searched()) continue;
        const periodic::PeriodicOrbit& orbit = computed.orbit;
        std::string point;
        for (Eigen::Index k = 0; orbit.points.cols() > 0 && k < orbit.points.rows(); ++k)
            point += fmt::format("{}{:.9g}", k == 0 ? "" : ", ", orbit.points(k, 0));
        const bool own_time = computed.converged() && orbits.own_time;
        const auto& stability = computed.stability;
        table.add({std::to_string(i), std::to_string(orbit.period), rotation_text(orbit.rotation),
                   own_time ? fmt::format("{:.9g}", orbit.time) : "", std::string(computed.status()), point,
                   multipliers_text(orbit.multipliers), stability ? std::to_string(stability->unstable) : "",
                   stability && stability->nearest != periodic::Bifurcation::none
                       ? std::string(periodic::name(stability->nearest))
                       : "",
                   significant(orbit.residual, 2)});
    }
    return table.text();
}

std::string instead_text(const ComputedOrbits& orbits) {
    std::string text;
    for (std::size_t i = 0; i < orbits.list.size(); ++i)
        if (orbits.list[i].computed && !orbits.list[i].message.empty())
            text += fmt::format("  orbit {}: {}\n", i, orbits.list[i].message);
    const auto left = std::count_if(orbits.list.begin(), orbits.list.end(),
                                    [](const ComputedOrbit& computed) { return !computed.computed; });
    if (left > 0) text += fmt::format("  {} starts: interrupted before their turn\n", left);
    return text;
}

/// What a search found, by period.
std::string search_table(const ComputedOrbits& orbits) {
    struct Row {
        std::size_t count = 0;
        std::size_t symmetric = 0;
        std::size_t pairs = 0;  ///< orbits that have a mirror image other than themselves, halved at the end
        std::size_t stable = 0;
        std::map<std::string, std::size_t> origins;
        double least = std::numeric_limits<double>::infinity();
        double largest = 0.0;
    };
    std::map<int, Row> rows;
    for (std::size_t i = 0; i < orbits.list.size(); ++i) {
        const ComputedOrbit& computed = orbits.list[i];
        if (!computed.searched() || !computed.converged()) continue;
        Row& row = rows[computed.orbit.period];
        ++row.count;
        ++row.origins[computed.origin];
        if (computed.mirror) ++(*computed.mirror == static_cast<int>(i) ? row.symmetric : row.pairs);
        if (computed.orbit.multipliers.empty()) continue;
        const double largest = std::abs(computed.orbit.multipliers.front());
        if (largest < 1.0) ++row.stable;
        row.least = std::min(row.least, largest);
        row.largest = std::max(row.largest, largest);
    }
    SummaryTable table({"period", "orbits", "mirror pairs", "symmetric", "stable", left_aligned("largest |multiplier|"),
                        left_aligned("found from")});
    for (const auto& [period, row] : rows) {
        std::string origins;
        for (const auto& [origin, count] : row.origins)
            origins += fmt::format("{}{} {}", origins.empty() ? "" : ", ", origin, count);
        table.add(
            {std::to_string(period), std::to_string(row.count), row.pairs > 0 ? std::to_string(row.pairs / 2) : "",
             row.symmetric > 0 ? std::to_string(row.symmetric) : "", row.stable > 0 ? std::to_string(row.stable) : "",
             row.largest > 0.0 ? fmt::format("{:.4g} ... {:.4g}", row.least, row.largest) : "", origins});
    }
    if (!table.empty() || !orbits.searched) return table.text();
    // Starts are recurrences of the model's own motion: without them there was nothing to solve.
    if (orbits.starts == 0)
        return "  none found: in none of the periods did the model's motion come back near to where it began\n";
    return fmt::format("  none found: of {}, none closed on an orbit of the periods that were asked for\n",
                       counted(orbits.starts, "solved start"));
}

}  // namespace

std::string orbits_summary(const ComputedOrbits& orbits) {
    std::string text = titled("Periodic orbits of the model", starts_table(orbits));
    text += titled("Found instead", instead_text(orbits));
    text += titled("Periodic orbits found by the search", search_table(orbits));
    if (orbits.searched && orbits.interrupted) text += "  the search was interrupted\n";
    if (!orbits.unsettled.empty())
        text += fmt::format("  periods {}: the last starts still led to new orbits; more \"points\" may find more\n",
                            fmt::join(orbits.unsettled, ", "));
    const std::vector<int>& sums = orbits.index_sums;
    if (std::adjacent_find(sums.begin(), sums.end(), std::not_equal_to<>()) != sums.end())
        text += fmt::format(
            "  orbits are missing: indices of the periods 1 to {} add up to {}, equal numbers in a complete list\n",
            sums.size(), fmt::join(sums, ", "));
    if (orbits.captured > 0)
        text += fmt::format("  {} of the search ended in a stable orbit or at rest\n",
                            counted(orbits.captured, "trajectory"));
    return text;
}

}  // namespace orbid::apps
