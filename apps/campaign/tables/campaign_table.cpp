#include "apps/campaign/tables/campaign_table.hpp"

#include <algorithm>
#include <array>
#include <set>
#include <stdexcept>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "apps/campaign/journal/journal_tables.hpp"
#include "apps/campaign/tables/csv_lines.hpp"
#include "models/system/stopped.hpp"

namespace orbid::apps {
namespace {

/// A parameter that some task has.
struct NamedParameter {
    std::string name;
    bool truth = false;  ///< a task knows it
    bool bound = false;
};

/// In the order of first appearance.
std::vector<NamedParameter> named_parameters(const Journal& journal) {
    std::vector<NamedParameter> names;
    Statement rows(journal.database(),
                   "SELECT name, truth IS NOT NULL, bound IS NOT NULL FROM parameter "
                   "ORDER BY task, position");
    std::size_t guess = 0;  // mostly the one after the last
    while (rows.step()) {
        const auto name = rows.bytes(0);
        if (guess >= names.size() || names[guess].name != name) {
            const auto found =
                std::find_if(names.begin(), names.end(), [&name](const auto& known) { return known.name == name; });
            guess = static_cast<std::size_t>(found - names.begin());
            if (found == names.end()) names.push_back({std::string(name)});
        }
        names[guess].truth = names[guess].truth || rows.integer(1) != 0;
        names[guess].bound = names[guess].bound || rows.integer(2) != 0;
        if (++guess >= names.size()) guess = 0;
    }
    return names;
}

constexpr std::array time_columns{"attempts", "host", "rank", "started", "seconds", "processor_seconds"};

/// A row's cells of time_columns.
void write_times(CsvLines& csv, const Journal::Row& row) {
    const TaskOutcome& outcome = row.outcome;
    csv.number(std::int64_t{row.attempts});
    if (outcome.state == TaskState::waiting) {
        csv.empty().empty().empty().empty().empty();
        return;
    }
    csv.text(outcome.host).number(std::int64_t{outcome.rank}).number(outcome.started);
    csv.number(outcome.seconds).number(outcome.processor_seconds);
}

/// Writes the names of columns; those of what varies give way to others.
class Heading {
public:
    explicit Heading(std::vector<std::string> columns) : columns_(std::move(columns)) {}
    void write(CsvLines& csv, const std::vector<VariedColumn>& varied, const std::vector<std::size_t>& which,
               std::size_t before) const {
        std::set<std::string> taken(columns_.begin(), columns_.end());
        for (std::size_t k = 0; k < before; ++k)
            csv.text(columns_[k]);
        for (const std::size_t column : which) {
            std::string name = varied[column].name;
            while (!taken.insert(name).second)
                name += "_varied";
            csv.text(name);
        }
        for (std::size_t k = before; k < columns_.size(); ++k)
            csv.text(columns_[k]);
        csv.end_line();
    }

private:
    std::vector<std::string> columns_;
};

std::vector<std::size_t> all_columns(const Journal& journal) {
    std::vector<std::size_t> out(journal.head().varied.size());
    for (std::size_t k = 0; k < out.size(); ++k)
        out[k] = k;
    return out;
}

std::vector<std::string> task_columns(const std::vector<NamedParameter>& names, bool times) {
    std::vector<std::string> columns{"number", "state", "status", "exit_code", "objective"};
    for (const NamedParameter& parameter : names) {
        columns.push_back(parameter.name);
        for (const auto* what : {"sd", "lower", "upper"})
            columns.push_back(fmt::format("{}_{}", parameter.name, what));
        if (parameter.truth) columns.push_back(parameter.name + "_truth");
        if (parameter.bound) columns.push_back(parameter.name + "_bound");
    }
    columns.emplace_back("message");
    if (times) columns.insert(columns.end(), time_columns.begin(), time_columns.end());
    return columns;
}

void write_parameters(CsvLines& csv, const std::vector<NamedParameter>& names,
                      const std::vector<TaskParameter>& parameters) {
    static const TaskParameter none;
    for (std::size_t k = 0; k < names.size(); ++k) {
        const auto has_name = [&](const TaskParameter& p) { return p.name == names[k].name; };
        const TaskParameter* parameter = &none;
        if (k < parameters.size() && has_name(parameters[k])) {
            parameter = &parameters[k];
        } else if (const auto found = std::find_if(parameters.begin(), parameters.end(), has_name);
                   found != parameters.end()) {
            parameter = &*found;
        }
        csv.number(parameter->value).number(parameter->sd).number(parameter->lower).number(parameter->upper);
        if (names[k].truth) csv.number(parameter->truth);
        if (names[k].bound) csv.number(parameter->bound);
    }
}

void write_varied(CsvLines& csv, const std::vector<std::string>& values) {
    for (const std::string& value : values)
        csv.text(varied_text(value));
}

void write_task(CsvLines& csv, const std::vector<NamedParameter>& names, const Journal::Row& row, bool times) {
    const TaskOutcome& outcome = row.outcome;
    const bool ended = outcome.state != TaskState::waiting;
    csv.number(row.plan.number);
    write_varied(csv, row.plan.values);
    csv.text(state_name(outcome.state));
    if (ended) {
        csv.text(outcome.status).number(std::int64_t{outcome.exit_code}).number(outcome.objective);
    } else {
        csv.empty().empty().empty();
    }
    write_parameters(csv, names, ended ? outcome.parameters : std::vector<TaskParameter>());
    csv.text(ended ? outcome.message : std::string());
    if (times) write_times(csv, row);
    csv.end_line();
}

void task_table(const Journal& journal, std::ostream& out, const TableOptions& options) {
    const auto names = named_parameters(journal);
    CsvLines csv(out);
    Heading(task_columns(names, options.times)).write(csv, journal.head().varied, all_columns(journal), 1);
    journal.each_row([&](const Journal::Row& row) {
        models::stop_if_asked(options.interrupted);
        write_task(csv, names, row, options.times);
    });
    csv.finish();
}

void parameter_table(const Journal& journal, std::ostream& out, const TableOptions& options) {
    std::vector<std::string> columns{"number", "status", "parameter", "value", "sd",
                                     "lower",  "upper",  "truth",     "bound"};
    if (options.times) columns.insert(columns.end(), time_columns.begin(), time_columns.end());
    CsvLines csv(out);
    Heading(columns).write(csv, journal.head().varied, all_columns(journal), 1);
    journal.each_row([&](const Journal::Row& row) {
        models::stop_if_asked(options.interrupted);
        if (row.outcome.state == TaskState::waiting) return;
        for (const TaskParameter& p : row.outcome.parameters) {
            csv.number(row.plan.number);
            write_varied(csv, row.plan.values);
            csv.text(row.outcome.status).text(p.name).number(p.value).number(p.sd);
            csv.number(p.lower).number(p.upper).number(p.truth).number(p.bound);
            if (options.times) write_times(csv, row);
            csv.end_line();
        }
    });
    csv.finish();
}

std::vector<std::string> summary_columns(const CampaignGroups& groups, bool times) {
    std::vector<std::string> columns{"tasks", "done", "converged", "valid", "failed"};
    for (std::size_t k = 0; k < groups.names().size(); ++k) {
        const ParameterStatistics& all = groups.all().parameter(k);
        std::vector<std::string> what{"count", "mean", "sd", "mean_sd"};
        if (all.error2.count() > 0) what.insert(what.end(), {"rms_z", "coverage", "coverage_lower", "coverage_upper"});
        if (all.over_bound2.count() > 0) what.emplace_back("rms_over_bound");
        for (const std::string& word : what)
            columns.push_back(fmt::format("{}_{}", groups.names()[k], word));
    }
    if (times) columns.emplace_back("mean_seconds");
    return columns;
}

void write_statistics(CsvLines& csv, const ParameterStatistics& statistics, const ParameterStatistics& all) {
    csv.number(statistics.value.count()).number(statistics.value.mean()).number(statistics.value.sd());
    csv.number(statistics.sd.mean());
    if (all.error2.count() > 0) {
        csv.number(statistics.rms_z()).number(statistics.coverage());
        if (statistics.intervals > 0) {
            const auto interval = statistics.coverage_interval();
            csv.number(interval.lower).number(interval.upper);
        } else {
            csv.empty().empty();
        }
    }
    if (all.over_bound2.count() > 0) csv.number(statistics.rms_over_bound());
}

void summary_table(const Journal& journal, std::ostream& out, const TableOptions& options) {
    CampaignGroups groups(journal.head().varied);
    journal.each_row([&](const Journal::Row& row) {
        models::stop_if_asked(options.interrupted);
        groups.add(row);
    });
    CsvLines csv(out);
    Heading(summary_columns(groups, options.times)).write(csv, journal.head().varied, groups.columns(), 0);
    for (const GroupStatistics& group : groups.groups()) {
        write_varied(csv, group.values);
        csv.number(group.tasks).number(group.done).number(group.converged).number(group.valid).number(group.failed);
        for (std::size_t k = 0; k < groups.names().size(); ++k)
            write_statistics(csv, group.parameter(k), groups.all().parameter(k));
        if (options.times) csv.number(group.seconds.mean());
        csv.end_line();
    }
    csv.finish();
}

}  // namespace

std::string varied_text(const std::string& json) {
    if (!json.starts_with('"')) return json;
    return nlohmann::json::parse(json).get<std::string>();
}

void write_campaign_table(const Journal& journal, std::ostream& out, const TableOptions& options) {
    switch (options.table) {
        case CampaignTable::tasks:
            return task_table(journal, out, options);
        case CampaignTable::parameters:
            return parameter_table(journal, out, options);
        case CampaignTable::summary:
            return summary_table(journal, out, options);
    }
    throw std::invalid_argument("there is no such table of a campaign");
}

}  // namespace orbid::apps
