#include "apps/campaign/report/campaign_chapters.hpp"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "apps/campaign/journal/journal_tables.hpp"
#include "apps/campaign/report/campaign_charts.hpp"
#include "apps/campaign/tables/campaign_table.hpp"
#include "apps/drawing/markup_text.hpp"
#include "apps/report/html_text.hpp"
#include "apps/results/summary_table.hpp"

namespace orbid::apps {
namespace {

using detail::grouped;

constexpr std::size_t most_rows = 200;

std::string grouped_number(std::int64_t value) {
    return grouped(static_cast<std::size_t>(std::max<std::int64_t>(value, 0)));
}

SummaryTable::Cell count_cell(std::int64_t count) {
    return {grouped_number(count), static_cast<double>(count)};
}

/// The share of intervals with the truth; caution where the nominal one lies outside of what chance explains.
SummaryTable::Cell coverage_cell(const ParameterStatistics& statistics) {
    if (statistics.intervals == 0) return "";
    const auto interval = statistics.coverage_interval();
    const bool fits = interval.lower <= interval_level && interval_level <= interval.upper;
    return {fmt::format("{:.1f} %", 100 * statistics.coverage()), statistics.coverage(), fits ? "" : "caution"};
}

SummaryTable::Cell coverage_interval_cell(const ParameterStatistics& statistics) {
    if (statistics.intervals == 0) return "";
    const auto interval = statistics.coverage_interval();
    return {fmt::format("{:.1f} to {:.1f} %", 100 * interval.lower, 100 * interval.upper), interval.lower};
}

std::vector<SummaryTable::Column> statistics_columns() {
    return {"estimates",
            "mean",
            explained("spread", "sd of the estimates"),
            explained("reported sd", "mean of the sds that the estimates claim; near the spread"),
            explained("rms z", "root mean square of (estimate − truth) / sd; near 1"),
            explained("coverage", "share of 95 % intervals that hold the truth"),
            left_aligned("95 % interval of it"),
            explained("rms error / bound", "root mean square error over the least sd that any estimate can have")};
}

void add_statistics(SummaryTable::Row& row, const ParameterStatistics& statistics) {
    if (statistics.value.count() == 0) {
        row.resize(row.size() + statistics_columns().size(), "");
        return;
    }
    row.push_back(count_cell(statistics.value.count()));
    row.push_back(estimate_cell(statistics.value.mean(), statistics.value.sd()));
    row.push_back(number_cell(statistics.value.sd(), 3));
    row.push_back(number_cell(statistics.sd.mean(), 3));
    row.push_back(number_cell(statistics.rms_z(), 3));
    row.push_back(coverage_cell(statistics));
    row.push_back(coverage_interval_cell(statistics));
    row.push_back(number_cell(statistics.rms_over_bound(), 3));
}

/// All parameters over all tasks.
std::string all_parameters_table(const CampaignFindings& findings) {
    std::vector<SummaryTable::Column> columns{left_aligned("parameter")};
    for (auto& column : statistics_columns())
        columns.push_back(std::move(column));
    SummaryTable table(std::move(columns));
    for (std::size_t k = 0; k < findings.groups.names().size(); ++k) {
        SummaryTable::Row row{findings.groups.names()[k]};
        add_statistics(row, findings.groups.all().parameter(k));
        table.add(std::move(row));
    }
    return html_table("Parameters over all valid tasks", table);
}

/// Columns of what makes settings, and their cells.
std::vector<SummaryTable::Column> setting_columns(const CampaignFindings& findings) {
    std::vector<SummaryTable::Column> columns;
    for (const std::size_t column : findings.groups.columns())
        columns.push_back(left_aligned(findings.head->varied[column].name));
    return columns;
}

SummaryTable::Row setting_cells(const GroupStatistics& group) {
    SummaryTable::Row row;
    for (const std::string& value : group.values)
        row.emplace_back(varied_text(value));
    return row;
}

std::string settings_table(const CampaignFindings& findings) {
    auto columns = setting_columns(findings);
    for (const auto* heading : {"tasks", "done"})
        columns.emplace_back(heading);
    columns.push_back(explained("valid", "done with exit code 0; statistics are of these"));
    for (const auto* heading : {"failed", "mean time [s]"})
        columns.emplace_back(heading);
    SummaryTable table(std::move(columns));
    for (const GroupStatistics& group : findings.groups.groups()) {
        if (table.rows().size() == most_rows) break;
        SummaryTable::Row row = setting_cells(group);
        for (const std::int64_t count : {group.tasks, group.done, group.valid})
            row.push_back(count_cell(count));
        row.emplace_back(grouped_number(group.failed), static_cast<double>(group.failed),
                         group.failed > 0 ? "caution" : "");
        row.push_back(number_cell(group.seconds.mean(), 3));
        table.add(std::move(row));
    }
    return html_table("Settings", table);
}

std::string parameter_by_setting(const CampaignFindings& findings, std::size_t parameter) {
    auto columns = setting_columns(findings);
    for (auto& column : statistics_columns())
        columns.push_back(std::move(column));
    SummaryTable table(std::move(columns));
    for (const GroupStatistics& group : findings.groups.groups()) {
        if (table.rows().size() == most_rows) break;
        if (group.parameter(parameter).value.count() == 0) continue;
        SummaryTable::Row row = setting_cells(group);
        add_statistics(row, group.parameter(parameter));
        table.add(std::move(row));
    }
    return html_table(fmt::format("{} by setting", findings.groups.names()[parameter]), table);
}

}  // namespace

ReportChapter settings_chapter(const CampaignFindings& findings) {
    ReportChapter chapter{"settings", "Settings", ""};
    if (findings.groups.all().valid > 0) chapter.html += all_parameters_table(findings);
    if (findings.groups.columns().empty()) return chapter;
    const std::size_t count = findings.groups.groups().size();
    if (findings.groups.left_out() > 0)
        chapter.html += html_paragraph(
            fmt::format("More than {} settings: the table of tables \"summary\" has all of them.", grouped(count)));
    else if (count > most_rows)
        chapter.html += html_paragraph(fmt::format(
            "{} settings, of which the first {} are shown; the table \"summary\" has all.", grouped(count), most_rows));
    chapter.html += settings_table(findings);
    if (count < 2) return chapter;
    // A page has room for so many tables.
    constexpr std::size_t most_tables = 12;
    for (std::size_t k = 0; k < std::min(most_tables, findings.groups.names().size()); ++k)
        chapter.html += parameter_by_setting(findings, k);
    return chapter;
}

ReportChapter coverage_chapter(const CampaignFindings& findings) {
    ReportChapter chapter{"coverage", "Do the intervals hold?", ""};
    chapter.html += figure_html(coverage_chart(findings),
                                "Share of 95 % intervals that hold the truth, with what chance leaves open "
                                "(Clopper and Pearson). Intervals that are right lie across the upright line.");
    chapter.html +=
        figure_html(z_chart(findings),
                    "Errors of the estimates in their own standard deviations. Right ones follow the curve; "
                    "wider columns mean sds that are too small.");
    chapter.html += figure_html(bound_chart(findings),
                                "Root mean square errors over the least standard deviation that any estimate without "
                                "bias can have. At 1 nothing is lost.");
    return chapter;
}

ReportChapter dependence_chapter(const CampaignFindings& findings) {
    ReportChapter chapter{"dependence", "Against what varied", ""};
    for (std::size_t k = 0; k < findings.axes.size(); ++k) {
        const Chart chart = dependence_chart(findings, k);
        const bool few = findings.numbers.size() <= CampaignFindings::few;
        chapter.html += figure_html(
            chart,
            few ? fmt::format("Every estimate with its interval, against {}; those of equal values stand side by side.",
                              findings.head->varied[findings.axes[k].column].name)
                : fmt::format("Where the estimates of {} valid tasks lie, against {}.",
                              grouped(findings.numbers.size()), findings.head->varied[findings.axes[k].column].name));
    }
    return chapter;
}

ReportChapter failure_chapter(const CampaignFindings& findings) {
    ReportChapter chapter{"failures", "What failed", ""};
    SummaryTable table(
        {left_aligned("state"), left_aligned("status"), "tasks", left_aligned("numbers"), left_aligned("message")});
    for (const FailureReason& reason : findings.status.reasons) {
        if (table.rows().size() == most_rows) break;
        std::string numbers;
        for (const std::int64_t task : reason.tasks)
            append_words(numbers, std::to_string(task), ", ");
        if (reason.count > static_cast<std::int64_t>(reason.tasks.size())) numbers += ", …";
        table.add(
            {std::string(state_name(reason.state)), reason.status, count_cell(reason.count), numbers, reason.message});
    }
    chapter.html = html_table("Reasons: messages alike but for numbers and names are one", table);
    return chapter;
}

ReportChapter time_chapter(const CampaignFindings& findings) {
    ReportChapter chapter{"times", "Times", ""};
    if (findings.seconds.empty()) return chapter;
    chapter.html = html_paragraph(time_words(findings.status)) +
                   figure_html(time_chart(findings), "How many tasks took how long, by the clock.");
    return chapter;
}

ReportChapter origin_chapter(const CampaignFindings& findings) {
    const JournalHead& head = *findings.head;
    return {"origin", "Where it comes from",
            html_paragraph(fmt::format("Campaign {} of kind {}, begun by orbid {}; all numbers are from its journal.",
                                       head.key.substr(0, 12), head.kind, head.version)) +
                fmt::format("<details><summary>The campaign</summary><pre tabindex=\"0\">{}</pre></details>\n",
                            markup_text(head.document))};
}

}  // namespace orbid::apps
