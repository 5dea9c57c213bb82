#include "apps/stored_run/stored_run.hpp"

#include <cmath>
#include <limits>
#include <string_view>

#include <fmt/format.h>

#include "apps/documents/atomic_file.hpp"
#include "apps/documents/json_value.hpp"
#include "apps/job/data_job.hpp"
#include "apps/job/reading/job_reader.hpp"
#include "apps/stages/data_stage.hpp"
#include "apps/stages/recorded_series.hpp"
#include "apps/stored_run/stored_shape.hpp"
#include "orbits/records/data_error.hpp"
#include "orbits/records/text_table.hpp"

namespace orbid::apps {

namespace {

using Json = StoredRun::Json;

/// @param format  what "format" must say; empty: the file has no such key.
std::optional<Json> read_file(const std::filesystem::path& file, std::string_view format) {
    if (!std::filesystem::exists(file)) return std::nullopt;
    const std::string text = read_whole_file(file);
    Json json;
    try {
        json = json_value<Json>(text);
    } catch (const JsonRefused& error) {
        const std::string_view said = error.what();  // "3:13: rule"
        const std::size_t place = said.find(": ");
        throw orbits::DataError(
            fmt::format("{}:{}: is not JSON that is stored here ({}); the file was changed or cut off after that",
                        file.string(), said.substr(0, place), said.substr(place + 2)));
    }
    if (!json.is_object())
        throw orbits::DataError(
            fmt::format("{}:1:1: must be an object {{ ... }}, is {}; the file was changed after it was stored",
                        file.string(), json.type_name()));
    if (format.empty()) return json;
    const auto found = json.find("format");
    if (found == json.end() || !found->is_string() || found->get<std::string>() != format)
        throw orbits::DataError(
            fmt::format("{}: /format: {}, this version reads \"{}\"; is this the folder of a run?", file.string(),
                        found == json.end() ? std::string("is missing") : fmt::format("is {}", found->dump()), format));
    return json;
}

/// The number of a cell; nan where it is empty.
double number_or_nan(const orbits::TextTable& table, std::string_view cell, std::size_t column) {
    return cell.empty() ? std::numeric_limits<double>::quiet_NaN() : table.number(cell, column);
}

/// A reader's first problem as an error of the stored file.
[[noreturn]] void refuse(const std::filesystem::path& file, const JobReading& reading) {
    throw orbits::DataError(reading.problems.empty() ? fmt::format("{}: cannot be read as a job", file.string())
                                                     : message(reading.problems.front(), file.string()));
}

}  // namespace

std::string StoredRun::title() const {
    const auto found = job.find("title");
    return found != job.end() && found->is_string() ? found->get<std::string>() : std::string();
}

std::vector<const Json*> StoredRun::experiments() const {
    std::vector<const Json*> list;
    const auto data = job.find("data");
    if (data == job.end()) return list;
    if (data->is_object()) list.push_back(&*data);
    if (data->is_array()) {
        for (const Json& experiment : *data)
            list.push_back(&experiment);
    }
    return list;
}

const Json* StoredRun::orbits_of_estimate() const {
    if (estimate_orbits) return &*estimate_orbits;
    return orbits ? &*orbits : nullptr;
}

const Json* StoredRun::shown_branch() const {
    if (estimate_branch) return &*estimate_branch;
    return branch ? &*branch : nullptr;
}

StoredRun read_stored_run(const std::filesystem::path& folder) {
    if (!std::filesystem::exists(folder)) throw StoredRunRefused(fmt::format("{}: no such folder", folder.string()));
    if (!std::filesystem::is_directory(folder))
        throw StoredRunRefused(
            fmt::format("{}: is a file; the folder with the results of a run is needed", folder.string()));
    StoredRun run;
    run.folder = folder;
    auto job = read_file(folder / "job.json", "orbid-job/1");
    if (!job)
        throw StoredRunRefused(fmt::format(
            "{}: holds no job.json, so it is no output folder of this program (orbid run JOB.json --out {})",
            folder.string(), folder.string()));
    run.job = std::move(*job);
    run.result = read_file(folder / "result.json", "orbid-result/1");
    if (run.result) check_result(folder / "result.json", *run.result);
    run.cycles = read_file(folder / "cycles.json", "orbid-cycles/1");
    run.orbits = read_file(folder / "orbits.json", "orbid-cycles/1");
    run.estimate_orbits = read_file(folder / "estimate_orbits.json", "orbid-cycles/1");
    run.branch = read_file(folder / "branch.json", "orbid-branches/1");
    run.estimate_branch = read_file(folder / "estimate_branch.json", "orbid-branches/1");
    for (const auto& [name, file] : {std::pair{"cycles.json", &run.cycles}, std::pair{"orbits.json", &run.orbits},
                                     std::pair{"estimate_orbits.json", &run.estimate_orbits}})
        if (*file) check_cycle_list(folder / name, **file);
    for (const auto& [name, file] :
         {std::pair{"branch.json", &run.branch}, std::pair{"estimate_branch.json", &run.estimate_branch}})
        if (*file) check_branch_list(folder / name, **file);
    run.invariants = read_file(folder / "invariants.json", "orbid-invariants/1");
    run.timing = read_file(folder / "timing.json", "");
    run.prediction = read_file(folder / "prediction.json", "orbid-prediction/1");
    return run;
}

namespace {

std::vector<ResidualRow> stored_rows(const std::filesystem::path& file) {
    std::vector<ResidualRow> rows;
    if (!std::filesystem::exists(file)) return rows;
    orbits::TextTable table(file);
    const std::size_t experiment = table.column("experiment");
    const std::size_t block = table.column("segment_or_cycle");
    const std::size_t coordinate = table.column("coordinate");
    const std::size_t at = table.column("time_or_phase");
    const std::size_t observed = table.column("observed");
    const std::size_t predicted = table.column("predicted");
    const std::size_t sd = table.column("sd");
    std::vector<std::string_view> cells;
    while (table.next(cells))
        rows.push_back({std::string(cells[experiment]), std::string(cells[block]), std::string(cells[coordinate]),
                        number_or_nan(table, cells[at], at), number_or_nan(table, cells[observed], observed),
                        number_or_nan(table, cells[predicted], predicted), number_or_nan(table, cells[sd], sd)});
    return rows;
}

}  // namespace

std::vector<ResidualRow> stored_residuals(const StoredRun& run) {
    return stored_rows(run.folder / "residuals.csv");
}

std::vector<ResidualRow> stored_predictions(const StoredRun& run) {
    return stored_rows(run.folder / "predictions.csv");
}

std::optional<StoredDraws> stored_draws(const StoredRun& run) {
    const auto file = run.folder / "posterior.csv";
    if (!std::filesystem::exists(file)) return std::nullopt;
    orbits::TextTable table(file);
    const std::size_t chain = table.column("chain");
    StoredDraws draws;
    std::vector<std::size_t> columns;
    for (std::size_t c = 0; c < table.header().size(); ++c) {
        const std::string& name = table.header()[c];
        if (name == "chain" || name == "draw" || name == "minus_log_density") continue;
        draws.names.push_back(name);
        columns.push_back(c);
    }
    draws.columns.resize(columns.size());
    std::vector<std::string_view> cells;
    while (table.next(cells)) {
        const double number = table.number(cells[chain], chain);
        constexpr double most = 1e6;  // far beyond any use: it guards the conversion
        if (!(std::abs(number) <= most)) table.fail(chain, "must be the number of a chain");
        draws.chain.push_back(static_cast<int>(number));
        for (std::size_t c = 0; c < columns.size(); ++c)
            draws.columns[c].push_back(number_or_nan(table, cells[columns[c]], columns[c]));
    }
    return draws;
}

Job stored_job(const StoredRun& run) {
    const auto file = run.folder / "job.json";
    JobReading reading = read_job_file(file);
    if (!reading.job) refuse(file, reading);
    return std::move(*reading.job);
}

ModelJob stored_model(const StoredRun& run) {
    const auto file = run.folder / "job.json";
    JobReading reading = read_job_model(run.job.dump(), file);
    if (!reading.job) refuse(file, reading);
    return std::move(reading.job->model);
}

std::optional<orbits::Series> stored_series(const StoredRun& run, std::size_t experiment) {
    const Job job = stored_job(run);
    if (experiment >= job.data.size())
        throw std::invalid_argument(
            fmt::format("stored series: experiment {}, must be in [0, {})", experiment, job.data.size()));
    if (job.data[experiment].streamed()) return std::nullopt;  // it need not fit into memory
    if (job.data[experiment].file) return recorded_series(job, experiment, run.interrupted);
    return simulated_series(job, experiment, run.folder, run.interrupted);
}

}  // namespace orbid::apps
