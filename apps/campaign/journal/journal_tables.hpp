#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "apps/campaign/journal/journal.hpp"
#include "apps/campaign/journal/row_values.hpp"
#include "apps/campaign/journal/sqlite.hpp"

namespace orbid::apps {

/// Bytes of a page; fixed, so that a file without a readable first page can be taken apart.
inline constexpr int journal_page = 4096;

/// Makes the tables of an empty file, always in the same order: their first pages have fixed numbers. The views follow
/// by make_views(), where they may fill further pages.
void make_tables(SqliteFile& file);
void make_views(SqliteFile& file, const JournalHead& head);

/// The head as one JSON text, and back.
[[nodiscard]] std::string head_text(const JournalHead& head);
/// @throws JournalDamaged when the text is no head.
[[nodiscard]] JournalHead head_from_text(std::string_view text);

/// Values of what varies as one JSON list, and back.
/// @throws std::invalid_argument when a value is no JSON.
[[nodiscard]] std::string choices_text(std::span<const std::string> values);
[[nodiscard]] std::vector<std::string> choices_from_text(std::string_view text);

/// 64 hexadecimal digits as 32 bytes; empty: the key is something else and stays as it is.
[[nodiscard]] std::string key_bytes(std::string_view key);
[[nodiscard]] std::string key_from_bytes(std::string_view bytes);

[[nodiscard]] std::string_view state_name(TaskState state);
/// @throws JournalDamaged for another word.
[[nodiscard]] TaskState state_from_name(std::string_view name);

/// What a row of the table `outcome` holds besides `state` of `outcome`.
struct OutcomeRow {
    TaskOutcome outcome;  ///< without parameters and result
    int attempts = 0;
    std::int64_t intervals = 0;    ///< parameters with an interval and a truth
    std::int64_t covered = 0;      ///< of them, truths within the interval
    std::uint32_t parameters = 0;  ///< checksum of the rows of `parameter`
    std::uint32_t result = 0;      ///< checksum of what `result` holds; 0: nothing
};

/// CRC-32 of a row, one for each table: rows whose checksum is another one are damaged.
[[nodiscard]] std::uint32_t head_checksum(std::string_view text);
[[nodiscard]] std::uint32_t plan_checksum(const TaskPlan& plan);
[[nodiscard]] std::uint32_t outcome_checksum(const OutcomeRow& row);
[[nodiscard]] std::uint32_t parameters_checksum(std::int64_t task, std::span<const TaskParameter> parameters);
/// 0 only for no bytes.
[[nodiscard]] std::uint32_t result_checksum(std::int64_t task, std::string_view bytes);

/// Columns as the functions below read them, for SELECT.
inline constexpr std::string_view plan_columns = "plan.number, plan.key, plan.seed, plan.choices, plan.checksum";
inline constexpr int plan_column_count = 5;
inline constexpr std::string_view outcome_columns =
    "outcome.task, state, attempts, exit_code, status, message, objective, started, seconds, processor_seconds, host, "
    "rank, intervals, covered, parameters_checksum, result_checksum, outcome.checksum";
inline constexpr int outcome_column_count = 17;
inline constexpr std::string_view parameter_columns = "task, position, name, value, sd, lower, upper, truth, bound";
inline constexpr int parameter_column_count = 9;

/// Reads rows from column `first` on.
/// @return false when the checksum does not fit.
[[nodiscard]] bool read_plan(const RowValues& row, int first, TaskPlan& plan);
[[nodiscard]] bool read_outcome(const RowValues& row, int first, OutcomeRow& out);
/// Without a check: the checksum is one for all parameters of a task.
void read_parameter(const RowValues& row, int first, TaskParameter& parameter);

/// The row of an outcome: coverage is counted, checksums are taken.
[[nodiscard]] OutcomeRow outcome_row(const TaskOutcome& outcome);

/// Statements that write rows, prepared once.
class RowWriter {
public:
    explicit RowWriter(SqliteFile& file);
    /// @return false, and nothing is written, when there is such a task already.
    [[nodiscard]] bool plan(const TaskPlan& plan);
    /// Replaces what there is of the task.
    void outcome(const OutcomeRow& row);
    void parameter(std::int64_t task, int position, const TaskParameter& parameter);
    void remove_parameters(std::int64_t task) { remove_parameters_.run(task); }
    void result(std::int64_t task, std::string_view bytes);
    void remove_result(std::int64_t task) { remove_result_.run(task); }
    void remove_outcome(std::int64_t task) { remove_outcome_.run(task); }

private:
    SqliteFile& file_;
    Statement plan_;
    Statement outcome_;
    Statement parameter_;
    Statement result_;
    Statement remove_parameters_;
    Statement remove_result_;
    Statement remove_outcome_;
};

}  // namespace orbid::apps
