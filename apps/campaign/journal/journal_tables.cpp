#include "apps/campaign/journal/journal_tables.hpp"

#include <zlib.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <stdexcept>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

namespace orbid::apps {
namespace {

/// Bytes of a row for its checksum: every value with its length, so that no two rows give the same bytes.
class RowDigest {
public:
    explicit RowDigest(char table) { bytes_ += table; }
    RowDigest& number(std::int64_t value) { return raw(&value, sizeof value); }
    RowDigest& real(double value) {
        // Stored as NULL: all nan are one.
        const double one_nan = std::isnan(value) ? std::numeric_limits<double>::quiet_NaN() : value;
        // Stored like 0.
        return number(std::bit_cast<std::int64_t>(one_nan == 0 ? 0.0 : one_nan));
    }
    RowDigest& text(std::string_view value) {
        number(static_cast<std::int64_t>(value.size()));
        return raw(value.data(), value.size());
    }
    [[nodiscard]] std::uint32_t checksum() const {
        return static_cast<std::uint32_t>(crc32_z(0, reinterpret_cast<const Bytef*>(bytes_.data()), bytes_.size()));
    }

private:
    RowDigest& raw(const void* data, std::size_t size) {
        bytes_.append(static_cast<const char*>(data), size);
        return *this;
    }
    std::string bytes_;
};

constexpr std::string_view tables = R"sql(
PRAGMA application_id=1869767012;
PRAGMA user_version=1;
CREATE TABLE head(id INTEGER PRIMARY KEY, content TEXT, checksum INTEGER);
CREATE TABLE head_copy(id INTEGER PRIMARY KEY, content TEXT, checksum INTEGER);
CREATE TABLE plan(number INTEGER PRIMARY KEY, key, seed INTEGER, choices TEXT, checksum INTEGER);
CREATE TABLE outcome(task INTEGER PRIMARY KEY, state TEXT, attempts INTEGER, exit_code INTEGER, status TEXT,
  message TEXT, objective REAL, started REAL, seconds REAL, processor_seconds REAL, host TEXT, rank INTEGER,
  intervals INTEGER, covered INTEGER, parameters_checksum INTEGER, result_checksum INTEGER, checksum INTEGER);
CREATE TABLE parameter(task INTEGER, position INTEGER, name TEXT, value REAL, sd REAL, lower REAL, upper REAL,
  truth REAL, bound REAL,
  error REAL AS (value - truth), z REAL AS ((value - truth) / sd), covered INTEGER AS (truth BETWEEN lower AND upper),
  PRIMARY KEY(task, position)) WITHOUT ROWID;
CREATE TABLE result(task INTEGER PRIMARY KEY, content BLOB);
)sql";

constexpr std::string_view views = R"sql(
CREATE VIEW campaign AS SELECT entry.key, entry.value FROM head, json_each(head.content) AS entry
  WHERE entry.key <> 'varied';
CREATE VIEW varied AS SELECT entry.key AS position, json_extract(entry.value, '$.name') AS name,
  json_extract(entry.value, '$.pointer') AS pointer, json_extract(entry.value, '$.replicate') AS replicate FROM head, json_each(head.content, '$.varied') AS entry;
CREATE VIEW task AS SELECT plan.number, CASE typeof(key) WHEN 'blob' THEN lower(hex(key)) ELSE key END AS key,
  coalesce(state, 'waiting') AS state, coalesce(attempts, 0) AS attempts, seed, started, seconds, processor_seconds,
  host, rank, exit_code, status, message, objective, intervals,
  covered AS intervals_covered, choices
  FROM plan LEFT JOIN outcome ON outcome.task = plan.number;
CREATE VIEW choice AS SELECT plan.number AS task, varied.position, varied.name, entry.value
  FROM plan, json_each(plan.choices) AS entry JOIN varied ON varied.position = entry.key;
)sql";

/// A name as SQL writes it.
std::string quoted_name(std::string_view name) {
    std::string out = "\"";
    for (const char c : name)
        out += c == '"' ? std::string("\"\"") : std::string(1, c);
    return out + "\"";
}

constexpr std::string_view digits = "0123456789abcdef";

}  // namespace

void make_tables(SqliteFile& file) {
    file.run(std::string(tables));
}

void make_views(SqliteFile& file, const JournalHead& head) {
    file.run(std::string(views));
    // What varies as columns, one row for each task.
    std::string columns;
    for (std::size_t k = 0; k < head.varied.size(); ++k)
        columns += fmt::format(", json_extract(choices, '$[{}]') AS {}", k, quoted_name(head.varied[k].name));
    file.run("CREATE VIEW choices AS SELECT number AS task" + columns + " FROM plan");
}

std::string head_text(const JournalHead& head) {
    nlohmann::ordered_json varied = nlohmann::ordered_json::array();
    for (const VariedColumn& column : head.varied)
        varied.push_back({{"name", column.name}, {"pointer", column.pointer}, {"replicate", column.replicate}});
    const nlohmann::ordered_json json{{"title", head.title}, {"kind", head.kind},       {"document", head.document},
                                      {"key", head.key},     {"version", head.version}, {"created", head.created},
                                      {"tasks", head.tasks}, {"varied", varied}};
    return json.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace);
}

JournalHead head_from_text(std::string_view text) {
    try {
        const auto json = nlohmann::json::parse(text);
        JournalHead head{.title = json.at("title"),
                         .kind = json.at("kind"),
                         .document = json.at("document"),
                         .key = json.at("key"),
                         .version = json.at("version"),
                         .created = json.at("created"),
                         .tasks = json.at("tasks"),
                         .varied = {}};
        for (const auto& column : json.at("varied"))
            head.varied.push_back({column.at("name"), column.at("pointer"), column.value("replicate", false)});
        return head;
    } catch (const nlohmann::json::exception& error) {
        throw JournalDamaged(fmt::format("the journal does not say what its campaign is: {}", error.what()));
    }
}

std::string choices_text(std::span<const std::string> values) {
    std::string out = "[";
    for (const std::string& value : values) {
        if (!nlohmann::json::accept(value))
            throw std::invalid_argument(fmt::format("the value of what varies is no JSON: {}", value));
        if (out.size() > 1) out += ',';
        out += value;
    }
    return out + "]";
}

std::vector<std::string> choices_from_text(std::string_view text) {
    std::vector<std::string> values;
    if (text.size() <= 2) return values;
    std::size_t begin = 1;
    int depth = 0;
    bool quoted = false;
    for (std::size_t k = 1; k < text.size(); ++k) {
        const char c = text[k];
        if (quoted) {
            if (c == '\\') ++k;
            if (c == '"') quoted = false;
            continue;
        }
        if (c == '"') quoted = true;
        if (c == '[' || c == '{') ++depth;
        if (depth == 0 && (c == ',' || c == ']')) {
            values.emplace_back(text.substr(begin, k - begin));
            begin = k + 1;
        } else if (c == ']' || c == '}') {
            --depth;
        }
    }
    return values;
}

std::string key_bytes(std::string_view key) {
    if (key.size() != 64) return {};
    std::string bytes;
    for (std::size_t k = 0; k < key.size(); k += 2) {
        const auto high = digits.find(key[k]);
        const auto low = digits.find(key[k + 1]);
        if (high == std::string_view::npos || low == std::string_view::npos) return {};
        bytes += static_cast<char>(high * 16 + low);
    }
    return bytes;
}

std::string key_from_bytes(std::string_view bytes) {
    std::string key;
    for (const char c : bytes) {
        const auto value = static_cast<unsigned char>(c);
        key += digits[value / 16];
        key += digits[value % 16];
    }
    return key;
}

std::string_view state_name(TaskState state) {
    switch (state) {
        case TaskState::waiting:
            return "waiting";
        case TaskState::done:
            return "done";
        case TaskState::failed:
            return "failed";
    }
    throw std::logic_error("a task has no such state");
}

TaskState state_from_name(std::string_view name) {
    for (const TaskState state : {TaskState::waiting, TaskState::done, TaskState::failed})
        if (state_name(state) == name) return state;
    throw JournalDamaged(fmt::format("a task has the state \"{}\", which there is not", name));
}

std::uint32_t head_checksum(std::string_view text) {
    return RowDigest('h').text(text).checksum();
}

std::uint32_t plan_checksum(const TaskPlan& plan) {
    RowDigest digest('p');
    digest.number(plan.number).text(plan.key).number(plan.seed.has_value()).number(plan.seed.value_or(0));
    for (const std::string& value : plan.values)
        digest.text(value);
    return digest.checksum();
}

std::uint32_t outcome_checksum(const OutcomeRow& row) {
    const TaskOutcome& outcome = row.outcome;
    return RowDigest('o')
        .number(outcome.number)
        .text(state_name(outcome.state))
        .number(row.attempts)
        .number(outcome.exit_code)
        .text(outcome.status)
        .text(outcome.message)
        .real(outcome.objective)
        .real(outcome.started)
        .real(outcome.seconds)
        .real(outcome.processor_seconds)
        .text(outcome.host)
        .number(outcome.rank)
        .number(row.intervals)
        .number(row.covered)
        .number(row.parameters)
        .number(row.result)
        .checksum();
}

std::uint32_t parameters_checksum(std::int64_t task, std::span<const TaskParameter> parameters) {
    RowDigest digest('v');
    digest.number(task);
    for (const TaskParameter& p : parameters)
        digest.text(p.name).real(p.value).real(p.sd).real(p.lower).real(p.upper).real(p.truth).real(p.bound);
    return digest.checksum();
}

std::uint32_t result_checksum(std::int64_t task, std::string_view bytes) {
    if (bytes.empty()) return 0;
    return std::max(std::uint32_t{1}, RowDigest('r').number(task).text(bytes).checksum());
}

}  // namespace orbid::apps
