#include "apps/campaign/report/campaign_charts.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <fmt/format.h>

#include "apps/campaign/tables/campaign_table.hpp"

namespace orbid::apps {
namespace {

/// A line of the coverage chart: an interval with a point, in percent.
struct CoverageLines {
    ChartLayer intervals{LayerKind::intervals, "95 % interval of the share", 2};
    ChartLayer points{LayerKind::points, "share of intervals with the truth", 2};
    std::vector<std::string> names;

    void add(const std::string& name, const ParameterStatistics& statistics) {
        if (statistics.intervals == 0) return;
        const auto height = static_cast<double>(names.size());
        const auto interval = statistics.coverage_interval();
        intervals.lower.push_back(100 * interval.lower);
        intervals.upper.push_back(100 * interval.upper);
        intervals.y.push_back(height);
        points.add(100 * statistics.coverage(), height);
        points.labels.push_back(fmt::format("{}: {} of {}", name, statistics.covered, statistics.intervals));
        names.push_back(name);
    }
    [[nodiscard]] ChartView view(std::string label) && {
        ChartView view;
        if (names.empty()) return view;
        ChartRange range;
        range.include(100 * interval_level);
        range.include(intervals.lower);
        range.include(intervals.upper);
        view.label = std::move(label);
        view.x = range.axis("coverage", "%");
        view.x.upper = std::min(view.x.upper, 100.5);
        view.layers = {upright_rule(100 * interval_level, "nominal", Ink::ink), std::move(intervals),
                       std::move(points)};
        name_lines(view, std::move(names));
        return view;
    }
};

bool groups_are_drawn(const CampaignFindings& findings) {
    const std::size_t count = findings.groups.groups().size();
    return count > 1 && count <= most_drawn_groups;
}

}  // namespace

std::string group_name(const CampaignFindings& findings, const GroupStatistics& group) {
    std::string name;
    const auto& columns = findings.groups.columns();
    for (std::size_t k = 0; k < columns.size(); ++k)
        append_words(name, findings.head->varied[columns[k]].name + " " + varied_text(group.values[k]), ", ");
    return name;
}

Chart coverage_chart(const CampaignFindings& findings) {
    Chart chart{"coverage", "How often intervals hold the truth", "Parameter"};
    const auto& names = findings.groups.names();
    CoverageLines all;
    for (std::size_t k = 0; k < names.size(); ++k) {
        all.add(display_name(names[k]), findings.groups.all().parameter(k));
        const ParameterStatistics& statistics = findings.groups.all().parameter(k);
        if (statistics.intervals > 0)
            append_words(chart.description, fmt::format("{}: {:.1f} %", names[k], 100 * statistics.coverage()));
    }
    chart.add(std::move(all).view("all"));
    if (!groups_are_drawn(findings)) return chart;
    for (std::size_t k = 0; k < names.size(); ++k) {
        CoverageLines lines;
        for (const GroupStatistics& group : findings.groups.groups())
            lines.add(group_name(findings, group), group.parameter(k));
        chart.add(std::move(lines).view(names[k]));
    }
    return chart;
}

Chart z_chart(const CampaignFindings& findings) {
    Chart chart{"z", "Errors of the estimates over their sd", "Parameter", {}, Chart::Arrangement::tiles};
    constexpr double reach = ParameterSeries::z_reach;
    constexpr std::size_t bins = ParameterSeries::z_bins;
    for (std::size_t k = 0; k < findings.parameters.size(); ++k) {
        const auto& counts = findings.parameters[k].z_counts;
        if (counts.empty()) continue;
        double total = 0;
        for (const std::int64_t count : counts)
            total += static_cast<double>(count);
        ChartLayer bars{LayerKind::bars, "tasks", 2};
        ChartLayer normal{LayerKind::line, "standard normal", 1};
        ChartRange y;
        y.include(0.0);
        const double width = 2 * reach / static_cast<double>(bins);
        for (std::size_t bin = 0; bin <= bins; ++bin) {
            bars.x.push_back(-reach + width * static_cast<double>(bin));
            if (bin < bins) bars.y.push_back(static_cast<double>(counts[bin]) / (total * width));
        }
        for (double z = -reach; z <= reach + 0.01; z += 0.1)
            normal.add(z, std::exp(-0.5 * z * z) / std::sqrt(2 * std::numbers::pi));
        y.include(bars.y);
        y.include(normal.y);
        ChartView view;
        view.label = findings.groups.names()[k];
        ChartRange x;
        x.include(-reach);
        x.include(reach);
        view.x = x.axis(fmt::format("({0} − truth) / sd", display_name(view.label)), "");
        view.y = y.axis("density", "");
        view.y.lower = 0;
        view.layers = {std::move(bars), std::move(normal)};
        chart.add(std::move(view));
        const std::int64_t beyond = counts[bins] + counts[bins + 1];
        append_words(chart.description,
                     fmt::format("{}: rms {:.3g}, {} of {:.0f} beyond ±{:.0f}", findings.groups.names()[k],
                                 findings.groups.all().parameter(k).rms_z(), beyond, total, reach));
    }
    return chart;
}

Chart bound_chart(const CampaignFindings& findings) {
    Chart chart{"bound", "Root mean square error over the least one possible", "Parameter"};
    if (!groups_are_drawn(findings)) return chart;
    for (std::size_t k = 0; k < findings.groups.names().size(); ++k) {
        ChartLayer points{LayerKind::points, "rms error over bound", 2};
        std::vector<std::string> names;
        ChartRange x;
        x.include(1.0);
        for (const GroupStatistics& group : findings.groups.groups()) {
            const double ratio = group.parameter(k).rms_over_bound();
            if (!std::isfinite(ratio)) continue;
            points.add(ratio, static_cast<double>(names.size()));
            names.push_back(group_name(findings, group));
            points.labels.push_back(fmt::format("{}: {:.3g}", names.back(), ratio));
            x.include(ratio);
        }
        if (names.empty()) continue;
        ChartView view;
        view.label = findings.groups.names()[k];
        view.x = x.axis("rms error / bound", "");
        view.layers = {upright_rule(1.0, "bound", Ink::ink), std::move(points)};
        name_lines(view, std::move(names));
        chart.add(std::move(view));
    }
    return chart;
}

Chart time_chart(const CampaignFindings& findings) {
    Chart chart{"times", "Times of tasks"};
    ChartRange range;
    for (const float seconds : findings.seconds)
        if (seconds > 0) range.include(static_cast<double>(seconds));
    if (range.empty() || !(range.highest > range.lowest)) return chart;
    // Over a wide range the columns are equally wide in the logarithm.
    const bool log = range.highest > 30 * range.lowest;
    const auto scaled = [log](double value) { return log ? std::log(value) : value; };
    const double lower = scaled(range.lowest);
    const double width = scaled(range.highest) - lower;
    const auto columns =
        static_cast<std::size_t>(std::min(60.0, 2 * (1 + std::log2(static_cast<double>(findings.seconds.size())))));
    ChartLayer bars{LayerKind::bars, "tasks", 2};
    bars.y.assign(columns, 0.0);
    for (const float seconds : findings.seconds) {
        if (!(seconds > 0)) continue;
        const double place = (scaled(static_cast<double>(seconds)) - lower) / width * static_cast<double>(columns);
        bars.y[std::min(columns - 1, static_cast<std::size_t>(place))] += 1;
    }
    for (std::size_t k = 0; k <= columns; ++k) {
        const double edge = lower + width * static_cast<double>(k) / static_cast<double>(columns);
        bars.x.push_back(log ? std::exp(edge) : edge);
    }
    ChartRange y;
    y.include(0.0);
    y.include(bars.y);
    ChartView view;
    view.x = range.axis("time of a task", "s", log);
    view.y = y.axis("tasks", "");
    view.y.lower = 0;
    view.height = 0.35;
    view.layers = {std::move(bars)};
    chart.add(std::move(view));
    chart.description = fmt::format("from {:.3g} to {:.3g} s", range.lowest, range.highest);
    return chart;
}

}  // namespace orbid::apps
