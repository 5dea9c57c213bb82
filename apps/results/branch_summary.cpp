#include <algorithm>
#include <array>
#include <cmath>

#include <fmt/format.h>

#include "apps/results/periodic_summary.hpp"
#include "apps/results/summary_table.hpp"
#include "periodic/branches/continuation.hpp"

namespace orbid::apps {

namespace {

using periodic::Bifurcation;
using periodic::Branch;
using periodic::BranchEnd;
using periodic::BranchPoint;

std::string_view end_text(BranchEnd end) {
    constexpr std::array<std::string_view, 11> texts{"end of the range",
                                                     "closed",
                                                     "edge of the parameter's domain",
                                                     "\"points\" used up",
                                                     "no step converges",
                                                     "shrank to an equilibrium",
                                                     "\"maximum_time\" reached",
                                                     "met another branch",
                                                     "motion cannot be followed",
                                                     "start",
                                                     "interrupted"};
    return texts[static_cast<std::size_t>(end)];
}

std::string_view kind_text(Bifurcation bifurcation) {
    constexpr std::array<std::string_view, 5> texts{"", "fold", "period doubling", "Neimark-Sacker", "branch point"};
    return texts[static_cast<std::size_t>(bifurcation)];
}

/// A share of few percent; neither 0 % nor 100 % unless it is none or all.
std::string share_text(std::ptrdiff_t part, std::size_t all) {
    const double percent = 100.0 * static_cast<double>(part) / static_cast<double>(all);
    if (part > 0 && percent < 1.0) return "< 1 %";
    if (part < static_cast<std::ptrdiff_t>(all) && percent > 99.0) return "> 99 %";
    return fmt::format("{:.0f} %", percent);
}

std::string branches_table(const std::vector<Branch>& branches, const std::string& parameter) {
    SummaryTable table({"branch", "period", left_aligned("begins at"), left_aligned(parameter), "orbits", "stable",
                        left_aligned("ends")});
    for (std::size_t b = 0; b < branches.size(); ++b) {
        const Branch& branch = branches[b];
        const auto [least, largest] =
            std::minmax_element(branch.points.begin(), branch.points.end(),
                                [](const auto& x, const auto& y) { return x.parameter < y.parameter; });
        const auto stable = std::count_if(branch.points.begin(), branch.points.end(),
                                          [](const BranchPoint& point) { return point.unstable == 0; });
        std::string begins = std::string(end_text(branch.first));
        if (branch.origin) {
            const BranchPoint& origin = branches[branch.origin->branch].points[branch.origin->point];
            begins = fmt::format("{} of branch {}", kind_text(origin.bifurcation), branch.origin->branch);
        }
        table.add({std::to_string(b), std::to_string(branch_period(branch)), begins,
                   fmt::format("{:.6g} ... {:.6g}", least->parameter, largest->parameter),
                   std::to_string(branch.points.size()), share_text(stable, branch.points.size()),
                   std::string(end_text(branch.last))});
    }
    return table.text();
}

std::string multiplier_text(std::complex<double> value) {
    if (std::isnan(value.real())) return {};
    return value.imag() == 0.0 ? fmt::format("{:.6f}", value.real())
                               : fmt::format("{:.6f}{:+.6f}i", value.real(), value.imag());
}

std::string bifurcations_table(const std::vector<Branch>& branches, const std::string& parameter) {
    SummaryTable table({"branch", "orbit", "period", left_aligned("bifurcation"), parameter, "± error",
                        "critical multiplier", left_aligned("opens branch")});
    // More are for the file and the picture.
    constexpr std::size_t most = 60;
    const auto places = located_bifurcations(branches);
    for (std::size_t i = 0; i < std::min(most, places.size()); ++i) {
        const BranchPoint& point = branches[places[i].branch].points[places[i].point];
        table.add({std::to_string(places[i].branch), std::to_string(places[i].point),
                   std::to_string(point.orbit.period), std::string(kind_text(point.bifurcation)),
                   fmt::format("{:.12g}", point.parameter), significant(point.parameter_error, 1),
                   multiplier_text(critical_multiplier(point.orbit)),
                   fmt::format("{}", fmt::join(branches_from(branches, places[i]), ", "))});
    }
    std::string text = table.text();
    if (places.size() > most) text += fmt::format("  and {} more, in branch.json\n", places.size() - most);
    return text;
}

std::string cascades_table(const std::vector<Branch>& branches, const std::string& parameter) {
    SummaryTable table({"cascade", "period", parameter, "interval", "ratio of intervals"});
    const auto cascades = doubling_cascades(branches);
    for (std::size_t c = 0; c < cascades.size(); ++c) {
        std::vector<double> values;
        for (const BranchPlace& place : cascades[c])
            values.push_back(branches[place.branch].points[place.point].parameter);
        const std::vector<double> ratios = periodic::doubling_ratios(values);
        for (std::size_t k = 0; k < values.size(); ++k) {
            const BranchPlace& place = cascades[c][k];
            const int period = branches[place.branch].points[place.point].orbit.period;
            table.add({std::to_string(c), fmt::format("{} to {}", period, 2 * period),
                       fmt::format("{:.12g}", values[k]),
                       k == 0 ? "" : fmt::format("{:.6g}", values[k] - values[k - 1]),
                       k >= 2 && k - 2 < ratios.size() ? fmt::format("{:.5g}", ratios[k - 2]) : ""});
        }
    }
    return table.text();
}

}  // namespace

std::string branches_summary(const FollowedBranches& followed, const models::Parameter& parameter) {
    if (followed.branches.empty()) return titled("Branches", fmt::format("  none: {}\n", followed.message));
    const std::string heading =
        parameter.unit == "1" ? std::string(parameter.name) : fmt::format("{} [{}]", parameter.name, parameter.unit);
    std::string text = titled("Branches", branches_table(followed.branches, heading));
    text += titled("Bifurcations", bifurcations_table(followed.branches, heading));
    return text + titled("Cascades of period doublings", cascades_table(followed.branches, heading));
}

}  // namespace orbid::apps
