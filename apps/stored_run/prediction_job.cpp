#include "apps/stored_run/prediction_job.hpp"

#include <algorithm>
#include <vector>

#include <fmt/format.h>

#include "apps/documents/atomic_file.hpp"
#include "apps/documents/json_value.hpp"
#include "apps/job/reading/job_reader.hpp"
#include "orbits/records/data_error.hpp"
#include "orbits/records/text_table.hpp"

namespace orbid::apps {

namespace {

using Json = StoredRun::Json;

bool is_table(const std::filesystem::path& file) {
    const auto ending = file.extension();
    return ending == ".csv" || ending == ".tsv" || ending == ".txt" || ending == ".mat";
}

const Json& chosen_experiment(const StoredRun& run, const std::string& name) {
    const auto experiments = run.experiments();
    std::string names;
    for (const Json* one : experiments) {
        const auto own = one->value("name", std::string());
        if (own == name) return *one;
        names += (names.empty() ? "" : ", ") + own;
    }
    if (experiments.empty())
        throw StoredRunRefused(
            fmt::format("{}: its job has no \"data\": there is nothing that a record could be like; give a JSON file "
                        "with a \"data\" object",
                        run.folder.string()));
    if (!name.empty())
        throw StoredRunRefused(
            fmt::format("{}: there is no experiment \"{}\"; there are: {}", run.folder.string(), name, names));
    if (experiments.size() > 1)
        throw StoredRunRefused(
            fmt::format("{}: has several experiments: say by --experiment which of them the record is like: {}",
                        run.folder.string(), names));
    return *experiments.front();
}

/// Whether the measured inputs of an experiment come from a table of their own.
bool has_own_table(const Json& experiment) {
    return experiment.contains("inputs") && experiment["inputs"].is_object() && experiment["inputs"].contains("file");
}

/// Beginnings of another record: what was held at a value, and where to look for the others. Prior knowledge of the
/// first record's beginning does not hold for this one.
Json kept_beginnings(const Json& rules) {
    Json kept = Json::object();
    for (const auto& [coordinate, rule] : rules.items()) {
        if (!rule.is_object()) continue;
        Json own = rule;
        own.erase("prior");
        if (!own.empty()) kept[coordinate] = std::move(own);
    }
    return kept;
}

/// The table of the inputs in the place of that of the run, which belongs to another record.
void replace_inputs(const StoredRun& run, const std::filesystem::path& inputs, bool given, Json& entry) {
    if (!inputs.empty()) {
        if (!has_own_table(entry))
            throw StoredRunRefused(
                fmt::format("{}: its measured inputs, if any, are columns of the record itself: "
                            "leave --inputs out",
                            run.folder.string()));
        if (!std::filesystem::is_regular_file(inputs))
            throw orbits::DataError(fmt::format("{}: no such file", inputs.string()));
        entry["inputs"]["file"] = std::filesystem::absolute(inputs).string();
        entry["inputs"].erase("sha256");
    } else if (has_own_table(entry) && !given) {
        throw StoredRunRefused(fmt::format(
            "{}: its measured inputs come from a table of their own ({}), which belongs to its record: give "
            "that of the new record by --inputs FILE",
            run.folder.string(), entry["inputs"]["file"].get<std::string>()));
    }
}

/// A "data" object that stands in a file of its own, with its paths made absolute.
Json data_object(const std::filesystem::path& file) {
    Json object;
    try {
        object = json_value<Json>(read_whole_file(file), true);
    } catch (const JsonRefused& error) {
        throw orbits::DataError(fmt::format("{}:{}", file.string(), error.what()));
    }
    if (!object.is_object() || !object.contains("file") || !object["file"].is_string())
        throw orbits::DataError(
            fmt::format("{}: must hold one \"data\" object of a job, with \"file\" in it", file.string()));
    const auto folder = std::filesystem::absolute(file).parent_path();
    const auto beside = [&folder](Json& path) {
        path = (folder / path.get<std::string>()).lexically_normal().string();
    };
    beside(object["file"]);
    if (has_own_table(object) && object["inputs"]["file"].is_string()) beside(object["inputs"]["file"]);
    return object;
}

/// What a simulated experiment says of a table: its columns are the coordinates, as far as the table has them.
void describe_table(const ModelJob& model, const std::filesystem::path& file, Json& entry) {
    const orbits::TextTable table = orbits::open_table(file);
    const auto has = [&](std::string_view name) {
        return std::find(table.header().begin(), table.header().end(), name) != table.header().end();
    };
    Json columns = Json::object();
    if (has("segment")) columns["segment"] = "segment";
    if (has("t")) columns["time"] = "t";
    for (const models::Coordinate& coordinate : model.system->coordinates()) {
        const std::string name(coordinate.name);
        if (has(name)) columns[name] = name;
    }
    entry["columns"] = std::move(columns);
}

/// The experiment with another record in its place.
Json experiment_entry(const StoredRun& run, const Json& like, const std::filesystem::path& data,
                      const std::filesystem::path& inputs) {
    Json entry = like;
    for (const char* key :
         {"file", "files", "sha256", "simulate", "segments", "free", "initial_state", "window", "rows"})
        entry.erase(key);
    const bool simulated = like.contains("simulate");
    if (simulated) entry["kind"] = like["simulate"].contains("samples") ? "samples" : "section";
    if (like.contains("initial_state")) {
        if (Json kept = kept_beginnings(like["initial_state"]); !kept.empty()) entry["initial_state"] = std::move(kept);
    }
    if (data.extension() == ".json") {
        const Json given = data_object(data);
        for (const auto& [key, value] : given.items())
            entry[key] = value;
        replace_inputs(run, inputs, given.contains("inputs"), entry);
        if (is_table(entry["file"].get<std::string>()) && !entry.contains("columns") && simulated)
            describe_table(stored_model(run), entry["file"].get<std::string>(), entry);
        return entry;
    }
    entry["file"] = std::filesystem::absolute(data).string();
    replace_inputs(run, inputs, false, entry);
    if (!is_table(data)) {
        entry.erase("columns");
        entry.erase("missing");
    } else if (simulated || !entry.contains("columns")) {
        describe_table(stored_model(run), data, entry);
    }
    return entry;
}

/// The series residual of the run's job; null without one.
const Json* series_residual(const StoredRun& run) {
    const auto pointer = Json::json_pointer("/estimate/residuals");
    if (!run.job.contains(pointer)) return nullptr;
    for (const Json& residual : run.job.at(pointer))
        if (residual.value("type", std::string()) == "series") return &residual;
    return nullptr;
}

bool is_estimated(const Json& value) {
    return value == "estimate" || (value.is_object() && (value.contains("estimate") || value.contains("factor")));
}

/// The errors of a coordinate with every estimated part at its estimate. @return false where the run does not know
/// them.
bool settle_errors(const Json& estimated, Json& errors) {
    bool known = true;
    for (auto& [key, value] : errors.items()) {
        if (!is_estimated(value)) continue;
        if (key == "sd") {
            const bool factor = value.is_object() && value.contains("column");
            const auto found = estimated.find(factor ? "factor" : "sd");
            if (found == estimated.end() || !found->is_number()) {
                known = false;
            } else if (factor) {
                value["factor"] = *found;
            } else {
                value = *found;
            }
        } else if (estimated.contains(key) && estimated[key].is_object() && estimated[key].contains("value")) {
            value = estimated.at(key).at("value");
        }
    }
    return known;
}

/// Errors of the readings by coordinate, as a series residual has them.
Json settled_errors(const StoredRun& run, const std::string& experiment, bool& known) {
    const Json* residual = series_residual(run);
    known = residual != nullptr && residual->contains("errors");
    Json errors = Json::object();
    if (!known) return errors;
    for (const auto& [coordinate, entry] : residual->at("errors").items()) {
        Json settled = entry;
        Json estimated = Json::object();
        for (const std::string& group : {"series." + experiment + "." + coordinate, "series." + coordinate}) {
            if (run.result->contains("errors") && run.result->at("errors").contains(group)) {
                estimated = run.result->at("errors").at(group);
                break;
            }
        }
        if (!settle_errors(estimated, settled)) known = false;
        errors[coordinate] = std::move(settled);
    }
    return errors;
}

Job read_made_job(const StoredRun& run, const Json& document) {
    // Absolute paths throughout: where the job would stand does not matter.
    JobReading reading = read_job(document.dump(2), run.folder / "prediction.json");
    if (reading.job) return std::move(*reading.job);
    std::string text = fmt::format("{}: the record cannot be predicted by this run:", run.folder.string());
    for (const Problem& problem : reading.problems)
        text += fmt::format("\n  {}: {}", problem.pointer, problem.rule);
    throw orbits::DataError(text);
}

/// Puts the estimates that hold for an experiment into the model or the entry of the experiment. The model's become the
/// parameters of an estimate from there on, `free`.
/// @return their rows in the stored covariance.
std::vector<std::size_t> put_estimates(const Json& estimates, const std::string& experiment, Json& values, Json& entry,
                                       Json& free) {
    std::vector<std::size_t> rows;
    std::size_t row = 0;
    for (const auto& [parameter, estimate] : estimates.items()) {
        const std::size_t own_row = row++;
        if (!estimate.contains("value") || !estimate["value"].is_number()) continue;
        const auto at = parameter.find('@');
        const std::string base = parameter.substr(0, at);
        // A value at the beginning of a record is called u_0@run1: it belongs to that record.
        if (!values.contains(base)) continue;
        if (at != std::string::npos) {
            if (parameter.substr(at + 1) == experiment) entry["parameters"][base] = estimate["value"];
            continue;
        }
        // With equations in the job the value stands beside its unit and domain.
        (values[base].is_object() ? values[base]["value"] : values[base]) = estimate["value"];
        // Held in a prediction: a delay that moves would need inputs beyond the record.
        if (entry.value("delay", Json()) == base) continue;
        free[base] = {{"start", estimate["value"]}, {"scale", "linear"}};
        rows.push_back(own_row);
    }
    return rows;
}

/// These rows and columns of the stored covariance; empty where one of them is not known.
Eigen::MatrixXd stored_covariance(const Json& result, const std::vector<std::size_t>& rows) {
    const auto pointer = Json::json_pointer("/covariance/matrix");
    if (!result.contains(pointer)) return {};
    const Json& matrix = result.at(pointer);
    const auto count = static_cast<Eigen::Index>(rows.size());
    Eigen::MatrixXd covariance(count, count);
    for (Eigen::Index i = 0; i < count; ++i) {
        for (Eigen::Index j = 0; j < count; ++j) {
            const std::size_t a = rows[static_cast<std::size_t>(i)];
            const std::size_t b = rows[static_cast<std::size_t>(j)];
            // A direction that the data do not determine has no covariance.
            if (a >= matrix.size() || b >= matrix[a].size() || !matrix[a][b].is_number()) return {};
            covariance(i, j) = matrix[a][b].get<double>();
        }
    }
    return covariance;
}

}  // namespace

PredictionJob prediction_job(const StoredRun& run, const std::filesystem::path& data,
                             const std::filesystem::path& inputs, const std::string& experiment) {
    if (!run.result || !run.result->contains("parameters"))
        throw StoredRunRefused(fmt::format("{}: holds no estimate (result.json)", run.folder.string()));
    if (!std::filesystem::exists(data)) throw orbits::DataError(fmt::format("{}: no such file", data.string()));
    if (!std::filesystem::is_regular_file(data)) throw orbits::DataError(fmt::format("{}: is no file", data.string()));
    const Json& like = chosen_experiment(run, experiment);
    const auto name = like.value("name", std::string("data"));

    Json document;
    document["title"] = fmt::format("{} predicted by {}", data.filename().string(),
                                    run.title().empty() ? run.folder.filename().string() : run.title());
    document["model"] = run.job.at("model");
    for (const char* key : {"seed", "section"})
        if (run.job.contains(key)) document[key] = run.job[key];
    Json entry = experiment_entry(run, like, data, inputs);
    Json free = Json::object();
    const auto rows = put_estimates((*run.result)["parameters"], name, document["model"]["parameters"], entry, free);
    document["data"] = Json::array({entry});
    PredictionJob job;
    Json residual{{"type", "series"}, {"data", Json::array({name})}, {"interval", "segment"}};
    if (entry.value("kind", std::string()) != "samples") residual.erase("interval");
    const Json errors = settled_errors(run, name, job.known_errors);
    if (!errors.empty()) residual["errors"] = errors;
    document["estimate"] = {{"parameters", Json::object()}, {"residuals", Json::array({residual})}};
    document["output"] = {{"series", "none"}};
    job.stored = read_made_job(run, document);
    // A derivative does not ask how sections would be matched: predictions of one step need parameters alone.
    document["estimate"]["parameters"] = free;
    job.derived = read_made_job(run, document);
    job.covariance = stored_covariance(*run.result, rows);
    return job;
}

}  // namespace orbid::apps
