#include "apps/campaign/journal/journal_tables.hpp"

#include <cmath>

#include <fmt/format.h>

namespace orbid::apps {
namespace {

/// A state that a destroyed row may not have.
bool known_state(std::string_view name) {
    return name == "waiting" || name == "done" || name == "failed";
}

std::string insertion(std::string_view how, std::string_view table, int count) {
    std::string marks = "?";
    for (int k = 1; k < count; ++k)
        marks += ",?";
    return fmt::format("INSERT OR {} INTO {} VALUES({})", how, table, marks);
}

}  // namespace

bool read_plan(const RowValues& row, int first, TaskPlan& plan) {
    plan.number = row.integer(first);
    plan.key = row.blob(first + 1) ? key_from_bytes(row.bytes(first + 1)) : row.text(first + 1);
    plan.seed.reset();
    if (!row.null(first + 2)) plan.seed = row.integer(first + 2);
    plan.values = choices_from_text(row.bytes(first + 3));
    return row.integer(first + 4) == plan_checksum(plan);
}

bool read_outcome(const RowValues& row, int first, OutcomeRow& out) {
    const auto state = row.bytes(first + 1);
    if (!known_state(state)) return false;
    TaskOutcome& outcome = out.outcome;
    outcome.number = row.integer(first);
    outcome.state = state_from_name(state);
    out.attempts = static_cast<int>(row.integer(first + 2));
    outcome.exit_code = static_cast<int>(row.integer(first + 3));
    outcome.status = row.bytes(first + 4);
    outcome.message = row.bytes(first + 5);
    outcome.objective = row.real(first + 6);
    outcome.started = row.real(first + 7);
    outcome.seconds = row.real(first + 8);
    outcome.processor_seconds = row.real(first + 9);
    outcome.host = row.bytes(first + 10);
    outcome.rank = static_cast<int>(row.integer(first + 11));
    out.intervals = row.integer(first + 12);
    out.covered = row.integer(first + 13);
    out.parameters = static_cast<std::uint32_t>(row.integer(first + 14));
    out.result = static_cast<std::uint32_t>(row.integer(first + 15));
    return row.integer(first + 16) == outcome_checksum(out);
}

void read_parameter(const RowValues& row, int first, TaskParameter& parameter) {
    parameter.name = row.bytes(first + 2);
    parameter.value = row.real(first + 3);
    parameter.sd = row.real(first + 4);
    parameter.lower = row.real(first + 5);
    parameter.upper = row.real(first + 6);
    parameter.truth = row.real(first + 7);
    parameter.bound = row.real(first + 8);
}

OutcomeRow outcome_row(const TaskOutcome& outcome) {
    OutcomeRow row;
    row.outcome = outcome;
    row.outcome.parameters.clear();
    row.outcome.result.clear();
    row.attempts = 1;
    for (const TaskParameter& p : outcome.parameters) {
        if (std::isnan(p.truth) || std::isnan(p.lower) || std::isnan(p.upper)) continue;
        ++row.intervals;
        row.covered += p.lower <= p.truth && p.truth <= p.upper;
    }
    row.parameters = parameters_checksum(outcome.number, outcome.parameters);
    row.result = result_checksum(outcome.number, outcome.result);
    return row;
}

RowWriter::RowWriter(SqliteFile& file)
    : file_(file),
      plan_(file, insertion("IGNORE", "plan", plan_column_count)),
      outcome_(file, insertion("REPLACE", "outcome", outcome_column_count)),
      parameter_(file, insertion("IGNORE", "parameter", parameter_column_count)),
      result_(file, insertion("IGNORE", "result", 2)),
      remove_parameters_(file, "DELETE FROM parameter WHERE task=?"),
      remove_result_(file, "DELETE FROM result WHERE task=?"),
      remove_outcome_(file, "DELETE FROM outcome WHERE task=?") {}

bool RowWriter::plan(const TaskPlan& plan) {
    const std::string choices = choices_text(plan.values);
    const std::string bytes = key_bytes(plan.key);
    if (bytes.empty()) {
        plan_.run(plan.number, plan.key, plan.seed, choices, plan_checksum(plan));
    } else {
        plan_.run(plan.number, Blob{bytes}, plan.seed, choices, plan_checksum(plan));
    }
    return sqlite3_changes(file_.handle()) == 1;
}

void RowWriter::outcome(const OutcomeRow& row) {
    const TaskOutcome& outcome = row.outcome;
    outcome_.run(outcome.number, state_name(outcome.state), row.attempts, outcome.exit_code, outcome.status,
                 outcome.message, outcome.objective, outcome.started, outcome.seconds, outcome.processor_seconds,
                 outcome.host, outcome.rank, row.intervals, row.covered, row.parameters, row.result,
                 outcome_checksum(row));
}

void RowWriter::parameter(std::int64_t task, int position, const TaskParameter& p) {
    parameter_.run(task, position, p.name, p.value, p.sd, p.lower, p.upper, p.truth, p.bound);
}

void RowWriter::result(std::int64_t task, std::string_view bytes) {
    result_.run(task, Blob{bytes});
}

}  // namespace orbid::apps
