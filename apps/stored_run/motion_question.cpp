#include "apps/stored_run/motion_question.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include <fmt/format.h>

#include "apps/documents/atomic_file.hpp"
#include "apps/documents/json_reader.hpp"
#include "apps/documents/json_value.hpp"
#include "apps/job/estimate_job.hpp"
#include "apps/job/periodic_job.hpp"
#include "apps/job/reading/job_reader.hpp"
#include "apps/stored_run/stored_estimate.hpp"
#include "models/definition/parameter.hpp"
#include "orbits/records/data_error.hpp"
#include "orbits/records/series_file.hpp"

namespace orbid::apps {

namespace {

using Json = StoredRun::Json;

Json read_question(const std::filesystem::path& file) {
    if (!std::filesystem::is_regular_file(file))
        throw orbits::DataError(fmt::format("{}: no such file", file.string()));
    if (file.extension() != ".json") return {{"measured", {{"file", std::filesystem::absolute(file).string()}}}};
    try {
        return json_value<Json>(read_whole_file(file), true);
    } catch (const JsonRefused& error) {
        throw orbits::DataError(fmt::format("{}:{}", file.string(), error.what()));
    }
}

/// The run's residual of type branch; null without one.
const Json* branch_residual(const StoredRun& run) {
    const auto pointer = Json::json_pointer("/estimate/residuals");
    if (!run.job.contains(pointer)) return nullptr;
    for (const Json& residual : run.job.at(pointer))
        if (residual.value("type", std::string()) == "branch") return &residual;
    return nullptr;
}

/// Where a question is read: what is wrong with it names its file and place.
struct QuestionPlace {
    std::string file;

    [[noreturn]] void refuse(const std::string& pointer, const std::string& rule) const {
        throw StoredRunRefused(fmt::format("{}: {}{}{}", file, pointer, pointer.empty() ? "" : ": ", rule));
    }
    void require_keys(const Json& object, const std::string& pointer, const std::vector<std::string>& known) const {
        if (!object.is_object()) refuse(pointer, "must be an object");
        for (const auto& [key, value] : object.items())
            if (!is_in(key, known)) refuse(pointer + "/" + key, "unknown key" + suggestion(key, known));
    }
    [[nodiscard]] std::uint64_t whole(const Json& object, const std::string& pointer, const char* key,
                                      std::uint64_t usual, std::uint64_t lowest, std::uint64_t highest) const {
        if (!object.contains(key)) return usual;
        const Json& value = object[key];
        if (!value.is_number_unsigned() || value.get<std::uint64_t>() < lowest || value.get<std::uint64_t>() > highest)
            refuse(fmt::format("{}/{}", pointer, key),
                   fmt::format("must be a whole number in [{}, {}], not {}", lowest, highest, value.dump()));
        return value.get<std::uint64_t>();
    }
};

void set_value(Json& parameters, const std::string& name, double value) {
    if (parameters[name].is_object())
        parameters[name]["value"] = value;
    else
        parameters[name] = value;
}

/// Values of parameters that a question names.
std::vector<std::pair<std::string, double>> named_values(const Json& object, const std::string& pointer,
                                                         const Json& parameters, const QuestionPlace& place) {
    std::vector<std::string> known;
    for (const auto& [name, value] : parameters.items())
        known.push_back(name);
    place.require_keys(object, pointer, known);
    std::vector<std::pair<std::string, double>> values;
    for (const auto& [name, value] : object.items()) {
        if (!value.is_number()) place.refuse(pointer + "/" + name, "must be a number");
        values.emplace_back(name, value.get<double>());
    }
    return values;
}

/// The start of a residual's branch, from the fitted branch where that has the model's own value of the parameter: the
/// job's own start is near the orbit at the job's own values, the other one is the orbit at the estimate.
void start_on_fitted_branch(const StoredRun& run, double own, Json& residual) {
    const Json* file = run.shown_branch();
    if (file == nullptr || !file->contains("branches") || file->at("parameter").at("name") != residual.at("parameter"))
        return;
    for (const Json& branch : file->at("branches"))
        for (const Json& point : branch.at("points")) {
            if (point.at("parameter") != own) continue;
            residual["orbit"]["points"] = point.at("points");
            if (residual["orbit"].contains("time")) residual["orbit"]["time"] = point.at("time");
            return;
        }
}

/// "measured" as a residual of type branch: what the question leaves out is the run's.
Json measured_residual(const StoredRun& run, const Json& question, const Json& parameters,
                       const std::filesystem::path& folder, const QuestionPlace& place) {
    Json residual{{"type", "branch"}};
    if (!question["measured"].is_object()) place.refuse("/measured", "must be an object");
    if (const Json* own = branch_residual(run)) {
        residual = *own;
        residual.erase("file");
        residual.erase("sha256");
        const std::string parameter = residual.value("parameter", std::string());
        if (!question["measured"].contains("orbit"))
            start_on_fitted_branch(run, detail::stored_value(parameters.value(parameter, Json())), residual);
    }
    for (const auto& [key, value] : question["measured"].items())
        if (key != "stable") residual[key] = value;
    if (!residual.contains("file") || !residual["file"].is_string())
        place.refuse("/measured", "\"file\" is missing: the table of the measured motions");
    residual["file"] = (folder / residual["file"].get<std::string>()).lexically_normal().string();
    // Columns may be named anew; errors belong to those that are left.
    if (question["measured"].contains("columns") && residual.contains("errors") &&
        !question["measured"].contains("errors")) {
        Json errors = Json::object();
        for (const auto& [name, error] : residual["errors"].items())
            if (residual["columns"].contains(name)) errors[name] = error;
        residual["errors"] = errors;
    }
    return residual;
}

/// Values of the parameter in a table of measured motions.
Eigen::VectorXd measured_values(const BranchResidualJob& branch, const Job& job) {
    orbits::TableLayout layout;
    const models::Parameter& parameter = job.model.parameter(branch.parameter);
    layout.coordinates.push_back({{std::string(parameter.name), std::string(parameter.unit), false},
                                  branch.at.column,
                                  branch.at.unit,
                                  static_cast<double>(branch.at.sign),
                                  branch.at.offset,
                                  {},
                                  branch.at.factor});
    return orbits::read_csv(*branch.file, layout).segments.front().values.row(0);
}

/// The branch of measured motions as a "periodic" block: over their values and half as far again.
Json periodic_of(const Json& residual, double own, const Eigen::VectorXd& at) {
    double lower = std::min(own, at.minCoeff());
    double upper = std::max(own, at.maxCoeff());
    const double beyond = 0.5 * (upper > lower ? upper - lower : std::max(std::abs(own), 1.0));
    lower = lower > 0.0 ? std::max(lower - beyond, 0.5 * lower) : lower - beyond;
    upper += beyond;
    if (residual.contains("range")) {
        lower = std::min(lower, residual.at("range").at(0).get<double>());
        upper = std::max(upper, residual.at("range").at(1).get<double>());
    }
    return {{"orbits", Json::array({residual.at("orbit")})},
            {"continuation", {{"parameter", residual.at("parameter")}, {"range", {lower, upper}}}}};
}

/// Reads the job that a question has become. Its places are named as the question has them.
Job read_asked_job(const StoredRun& run, const Json& document, const QuestionPlace& place) {
    JobReading reading = read_job(document.dump(2), run.folder / "prediction.json");
    if (reading.job) return std::move(*reading.job);
    std::string text = fmt::format("{}: cannot be answered by {}:", place.file, run.folder.string());
    for (const Problem& problem : reading.problems) {
        std::string pointer = problem.pointer;
        for (const auto& [from, to] : {std::pair<std::string, std::string>{"/estimate/residuals/0", "/measured"},
                                       {"/model/parameters", "/parameters"}})
            if (pointer.starts_with(from)) pointer = to + pointer.substr(from.size());
        text += fmt::format("\n  {}: {}", pointer, problem.rule);
    }
    throw StoredRunRefused(text);
}

/// Puts measured motions into a document, and the branch that they are compared with where there is none.
void add_measured(const StoredRun& run, const Json& residual, const QuestionPlace& place, Json& document) {
    document["estimate"] = {{"parameters", Json::object()}, {"residuals", Json::array({residual})}};
    if (document.contains("periodic")) return;
    const Job job = read_asked_job(run, document, place);
    const BranchResidualJob& branch = *job.estimate->branch;
    document["periodic"] = periodic_of(residual, job.model.values[branch.parameter], measured_values(branch, job));
}

void check_periodic(const Json& periodic, const QuestionPlace& place) {
    place.require_keys(periodic, "/periodic", {"orbits", "continuation"});
    if (!periodic.contains("orbits"))
        place.refuse("/periodic", "\"orbits\" is missing: starts, as in the \"periodic\" block of a job");
    if (!periodic.contains("continuation")) return;
    const Json& continuation = periodic["continuation"];
    if (continuation.is_object() && continuation.contains("switch") && !continuation["switch"].empty())
        place.refuse("/periodic/continuation/switch", "must be [] or left out: one branch is predicted");
}

std::vector<Eigen::VectorXd> asked_values(const Json& question, const Json& parameters, const Job& job,
                                          const QuestionPlace& place) {
    std::vector<Eigen::VectorXd> at;
    if (!question.contains("at")) return {job.model.values};
    if (!question["at"].is_array() || question["at"].empty())
        place.refuse("/at", "must be a list of objects: [ { \"omega\": 1.2 }, ... ]");
    for (std::size_t i = 0; i < question["at"].size(); ++i) {
        const std::string pointer = fmt::format("/at/{}", i);
        Eigen::VectorXd values = job.model.values;
        for (const auto& [name, value] : named_values(question["at"][i], pointer, parameters, place)) {
            const Eigen::Index index = job.model.system->parameter_index(name);
            if (!models::contains(job.model.parameter(index).domain, value))
                place.refuse(pointer + "/" + name,
                             fmt::format("is {}, must be {}", value, models::rule(job.model.parameter(index).domain)));
            values(index) = value;
        }
        at.push_back(std::move(values));
    }
    return at;
}

void read_bands(const Json& question, MotionQuestion& asked, const QuestionPlace& place) {
    asked.seed = asked.job.seed;
    if (!question.contains("bands")) return;
    const Json& bands = question["bands"];
    place.require_keys(bands, "/bands", {"method", "draws", "seed"});
    const std::string method = bands.contains("method") && bands["method"].is_string()
                                   ? bands["method"].get<std::string>()
                                   : std::string(bands.contains("method") ? "" : "draws");
    if (method != "draws" && method != "delta") place.refuse("/bands/method", "must be \"draws\" or \"delta\"");
    asked.draws = method == "draws";
    if (!asked.draws && bands.contains("draws")) place.refuse("/bands/draws", "belongs to the method \"draws\"");
    asked.count = place.whole(bands, "/bands", "draws", asked.count, 2, 100000);
    asked.seed = place.whole(bands, "/bands", "seed", asked.seed, 0, std::uint64_t{1} << 53);
}

}  // namespace

bool is_motion_question(const StoredRun& run, const std::filesystem::path& file) {
    if (!std::filesystem::is_regular_file(file)) return false;
    if (file.extension() != ".json") return run.experiments().empty() && branch_residual(run) != nullptr;
    const auto json = json_value_or_discarded<Json>(read_whole_file(file), true);
    return json.is_object() && (json.contains("periodic") || json.contains("measured"));
}

MotionQuestion motion_question(const StoredRun& run, const std::filesystem::path& file, const std::string& experiment) {
    const QuestionPlace place{file.string()};
    const Json question = read_question(file);
    place.require_keys(question, "", {"title", "parameters", "periodic", "at", "measured", "bands"});
    if (!run.result || !run.result->contains("parameters"))
        throw StoredRunRefused(fmt::format("{}: holds no estimate (result.json)", run.folder.string()));
    if (question.contains("periodic")) check_periodic(question["periodic"], place);

    Json document;
    document["title"] = question.contains("title") && question["title"].is_string()
                            ? question["title"].get<std::string>()
                            : fmt::format("{} predicted by {}", file.filename().string(),
                                          run.title().empty() ? run.folder.filename().string() : run.title());
    document["model"] = run.job.at("model");
    for (const char* key : {"seed", "section", "flow"})
        if (run.job.contains(key)) document[key] = run.job[key];
    Json parameters = document["model"].at("parameters");
    const auto estimates = stored_estimates(run, parameters, experiment);
    for (const StoredEstimate& one : estimates)
        set_value(parameters, one.model_name, one.value);
    const Json held = question.contains("parameters") ? question["parameters"] : Json::object();
    for (const auto& [name, value] : named_values(held, "/parameters", parameters, place))
        set_value(parameters, name, value);
    document["model"]["parameters"] = parameters;
    if (question.contains("periodic")) document["periodic"] = question["periodic"];
    if (question.contains("measured")) {
        const auto folder = std::filesystem::absolute(file).parent_path();
        add_measured(run, measured_residual(run, question, parameters, folder, place), place, document);
    }
    if (!document.contains("periodic")) place.refuse("", "\"periodic\" or \"measured\" is needed");
    if (Json& periodic = document["periodic"];
        periodic.contains("continuation") && periodic["continuation"].is_object())
        periodic["continuation"]["switch"] = Json::array();
    document["output"] = {{"series", "none"}};
    MotionQuestion asked;
    asked.job = read_asked_job(run, document, place);
    if (asked.job.estimate && !asked.job.periodic->continuation)
        place.refuse("/periodic", "\"continuation\" is missing: measured motions are compared with a branch");
    if (asked.job.estimate &&
        asked.job.estimate->branch->parameter != asked.job.periodic->continuation->options.parameter)
        place.refuse("/periodic/continuation/parameter", "must be that of the measured motions");
    asked.at = asked_values(question, parameters, asked.job, place);
    asked.asks_orbits = question.contains("at");
    if (question.contains("measured") && question["measured"].contains("stable")) {
        const Json& stable = question["measured"]["stable"];
        if (!stable.is_boolean()) place.refuse("/measured/stable", "must be true or false");
        asked.stable = stable.get<bool>();
    }
    read_bands(question, asked, place);
    std::vector<StoredEstimate> free;
    for (const StoredEstimate& one : estimates)
        if (!held.contains(one.model_name) && !one.held) free.push_back(one);
    asked.posterior = stored_posterior(run, asked.job.model, free, asked.draws);
    const std::string status = run.result->value("status", std::string());
    if (status != "converged")
        asked.remarks.push_back(fmt::format("the estimate is not converged ({}): neither are the bands", status));
    return asked;
}

}  // namespace orbid::apps
