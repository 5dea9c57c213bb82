// Measured periodic steady states in jobs: from simulation or table to the estimate, and what is refused.

#include <cmath>
#include <sstream>

#include "tests/apps/job/job_problems.hpp"
#include "tests/apps/program/program.hpp"
#include "tests/catch.hpp"
#include "tests/source_folder.hpp"

namespace waveform_run_test {

using namespace orbid::tests;

namespace {

/// A hardening spring under two excitations, read every 0.25 s with errors that last.
json spring_job() {
    return json::parse(R"({
      "model": { "name": "duffing", "parameters": { "delta": 0.3, "alpha": 1.0, "beta": 1.0, "gamma": 0.5 } },
      "seed": 5,
      "data": [
        { "name": "slow", "parameters": { "omega": 0.8 }, "observe": ["x"],
          "simulate": { "samples": { "step": 0.25, "count": 120 }, "transient": 800, "initial": [[0.0, 0.0]],
                        "noise": { "x": { "sd": 0.02, "correlation": 0.6 } } } },
        { "name": "fast", "parameters": { "omega": 1.2 }, "observe": ["x"],
          "simulate": { "samples": { "step": 0.25, "count": 120 }, "transient": 800, "initial": [[0.0, 0.0]],
                        "noise": { "x": { "sd": 0.02, "correlation": 0.6 } } } } ],
      "estimate": {
        "parameters": { "delta": { "start": 0.4 }, "beta": { "start": 0.8 } },
        "residuals": [ { "type": "waveform", "offset": "estimate",
                         "errors": { "x": { "distribution": "ar1" } } } ] },
      "reference": { "delta": 0.3, "beta": 1.0 },
      "output": { "series": "csv" } })");
}

std::vector<std::vector<std::string>> rows_of(const Path& file) {
    std::vector<std::vector<std::string>> rows;
    std::istringstream lines(orbid::apps::read_whole_file(file));
    for (std::string line; std::getline(lines, line);) {
        if (line.starts_with("#")) continue;
        rows.emplace_back();
        std::istringstream cells(line);
        for (std::string cell; std::getline(cells, cell, ',');)
            rows.back().push_back(cell);
    }
    return rows;
}

/// One column of a stored series.
std::vector<double> column(const Path& file, const std::string& name) {
    const auto rows = rows_of(file);
    const auto at = std::find(rows[0].begin(), rows[0].end(), name) - rows[0].begin();
    std::vector<double> values;
    for (std::size_t k = 1; k < rows.size(); ++k)
        values.push_back(std::stod(rows[k][static_cast<std::size_t>(at)]));
    return values;
}

/// The text of a job with a residual changed, and of which one thing is wrong.
void check_refused(const json& change, const std::string& expected, json job = spring_job()) {
    for (const auto& entry : change.items())
        job["estimate"]["residuals"][0][entry.key()] = entry.value();
    check_only(job.dump(1), expected);
}

}  // namespace

TEST_CASE("steady states are simulated, stored and estimated from", "[apps][run][waveform]") {
    const TemporaryFolder folder;
    const Path out = folder.path() / "out";
    const Outcome run = orbid_with({"run", write_job(folder.path() / "job.json", spring_job()), "--out", out});
    CAPTURE(run.error);
    REQUIRE(run.code == 0);
    const json result = read_json(out / "result.json");
    CHECK(result["status"] == "converged");
    for (const char* name : {"delta", "beta"}) {
        CAPTURE(name);
        const json& parameter = result["parameters"][name];
        CHECK(parameter["sd"].get<double>() > 0.0);
        CHECK(std::abs(parameter["value"].get<double>() - parameter["reference"].get<double>()) <
              4.0 * parameter["sd"].get<double>());
    }
    const json& errors = result["errors"]["waveform.x"];
    CHECK(errors["distribution"] == "ar1");
    CHECK(errors["count"] == 240);
    CHECK(errors["unit"] == "1");
    // 240 readings with correlation 0.6: the sd to 7 %, the correlation to 0.055; four of that.
    CHECK_THAT(errors["sd"].get<double>(), WithinRel(0.02, 0.28));
    CHECK(std::abs(errors["correlation"]["value"].get<double>() - 0.6) <
          4.0 * errors["correlation"]["uncertainty"].get<double>());
    CHECK(errors["correlation"]["uncertainty"].get<double>() < 0.1);
    CHECK(errors["correlation"]["interval95"][0].get<double>() < errors["correlation"]["value"].get<double>());
    REQUIRE(result["residuals"].size() == 1);
    CHECK(result["residuals"][0]["type"] == "waveform");
    CHECK(result["residuals"][0]["used"] == 2);

    REQUIRE(result["steady_states"].size() == 2);
    for (const json& state : result["steady_states"]) {
        CAPTURE(state["experiment"]);
        CHECK(state["status"] == "converged");
        CHECK(state["used"] == true);
        // Simulated with phase 0 at time 0 and no offset.
        CHECK(state["phase"]["estimated"] == true);
        CHECK(std::abs(state["phase"]["value"].get<double>()) < 4.0 * state["phase"]["sd"].get<double>());
        const json& offset = state["offset"]["x"];
        CHECK(std::abs(offset["value"].get<double>()) < 4.0 * offset["sd"].get<double>());
        CHECK(state["points"].size() == 1);
        CHECK(std::hypot(state["multipliers"][0][0].get<double>(), state["multipliers"][0][1].get<double>()) < 1.0);
    }
    CHECK_THAT(result["steady_states"][0]["time"].get<double>(), WithinRel(2.0 * 3.14159265358979 / 0.8, 1e-9));
    const auto rows = rows_of(out / "residuals.csv");
    REQUIRE(rows.size() == 241);
    CHECK(rows[1][0] == "slow");
    CHECK(rows[1][2] == "x");
    CHECK(rows[240][0] == "fast");
    CHECK_THAT(std::stod(rows[1][6]), WithinRel(errors["sd"].get<double>(), 1e-12));

    // The complete job gives the same bytes, on one thread as well.
    REQUIRE(orbid_with({"run", out / "job.json", "--out", folder.path() / "again", "--threads", "1"}).code == 0);
    for (const char* name : {"result.json", "residuals.csv", "series_slow.csv"})
        CHECK(orbid::apps::read_whole_file(out / name) == orbid::apps::read_whole_file(folder.path() / "again" / name));

    // The same records as tables: the same estimate, to the digits of the start that differ.
    json tables = spring_job();
    for (json& data : tables["data"]) {
        data.erase("simulate");
        data["file"] = (out / ("series_" + data["name"].get<std::string>() + ".csv")).string();
        data["kind"] = "samples";
        data["columns"] = {{"segment", "segment"}, {"time", "t"}, {"x", "x"}};
    }
    const Outcome read =
        orbid_with({"run", write_job(folder.path() / "tables.json", tables), "--out", folder.path() / "tables"});
    CAPTURE(read.error);
    REQUIRE(read.code == 0);
    const json same = read_json(folder.path() / "tables" / "result.json");
    CHECK_THAT(same["parameters"]["beta"]["value"].get<double>(),
               WithinRel(result["parameters"]["beta"]["value"].get<double>(), 1e-9));
}

TEST_CASE("steady states that are too short are refused by the names of all of them", "[apps][run][waveform]") {
    const TemporaryFolder folder;
    json job = spring_job();
    job["data"][0]["name"] = "run10";
    job["data"][1]["name"] = "run1";
    for (json& data : job["data"])
        data["simulate"]["samples"] = {{"step", 4.0}, {"count", 3}};
    for (const char* name : {"alpha", "gamma"})
        job["estimate"]["parameters"][name] = {{"start", 0.8}};
    const Outcome run = orbid_with({"run", write_job(folder.path() / "job.json", job), "--out", folder.path() / "out"});
    CHECK(run.code == 3);
    CHECK_THAT(run.error, ContainsSubstring("run10, run1: too short: 6 readings for 4 free parameters"));
}

TEST_CASE("the example of a waveform job", "[apps][run][waveform]") {
    const TemporaryFolder folder;
    const Outcome run = orbid_with({"run", orbid::tests::source_folder() + "/configs/landing_gear_waveform.json",
                                    "--out", folder.path() / "out", "--quiet"});
    CAPTURE(run.error);
    REQUIRE(run.code == 0);
    const json result = read_json(folder.path() / "out" / "result.json");
    CHECK(result["residuals"][0]["used"] == 6);
    for (const char* name : {"kappa", "c_compression", "c_rebound", "friction"}) {
        CAPTURE(name);
        const json& parameter = result["parameters"][name];
        CHECK(std::abs(parameter["value"].get<double>() - parameter["reference"].get<double>()) <
              4.0 * parameter["sd"].get<double>());
    }
    CHECK(result["identifiability"]["trust_normal"] == true);
}

TEST_CASE("errors of simulated readings may last", "[apps][data][waveform]") {
    const TemporaryFolder folder;
    // At rest: what is recorded are the errors.
    json job = json::parse(R"({
      "model": { "name": "duffing", "parameters": { "gamma": 0.0, "alpha": 1.0 } }, "seed": 3,
      "data": [ { "name": "a", "simulate": { "samples": { "step": 0.1, "count": 20000 }, "initial": [[0.0, 0.0]],
                    "noise": { "x": { "sd": 0.5, "correlation": 0.8 }, "x_dot": 2.0 } } },
                { "name": "b", "simulate": { "samples": { "step": 0.1, "count": 20000 }, "initial": [[0.0, 0.0]],
                    "noise": { "x": { "sd": 0.5, "correlation": 0.8 }, "x_dot": { "sd": 2.0 } } } } ],
      "output": { "series": "csv" } })");
    const Path out = folder.path() / "out";
    REQUIRE(orbid_with({"run", write_job(folder.path() / "job.json", job), "--out", out}).code == 0);
    const auto moments = [](const std::vector<double>& e) {
        double square = 0.0, product = 0.0;
        for (std::size_t k = 0; k < e.size(); ++k) {
            square += e[k] * e[k];
            if (k > 0) product += e[k] * e[k - 1];
        }
        return std::pair(std::sqrt(square / static_cast<double>(e.size())), product / square);
    };
    // sd of the sd: s sqrt((1 + rho^2) / (1 - rho^2) / 2 n) = 1.1 % of it; of the correlation sqrt((1 - rho^2) / n) =
    // 0.0042, independent 0.0071; four of each.
    const auto x = moments(column(out / "series_a.csv", "x"));
    CHECK_THAT(x.first, WithinRel(0.5, 0.044));
    CHECK(std::abs(x.second - 0.8) < 0.017);
    const auto v = moments(column(out / "series_a.csv", "x_dot"));
    CHECK_THAT(v.first, WithinRel(2.0, 0.02));
    CHECK(std::abs(v.second) < 0.029);
    // Experiments of one job have errors of their own.
    const auto a = column(out / "series_a.csv", "x"), b = column(out / "series_b.csv", "x");
    double product = 0.0;
    for (std::size_t k = 0; k < a.size(); ++k)
        product += a[k] * b[k];
    // Both correlated: sd 0.25 sqrt((1 + rho^2) / (1 - rho^2) / n) = 0.0038.
    CHECK(std::abs(product / static_cast<double>(a.size())) < 0.0152);

    const std::string text = job.dump();
    const auto with_noise = [&](const std::string& noise) {
        json changed = json::parse(text);
        changed["data"][0]["simulate"]["noise"] = json::parse(noise);
        return changed.dump(1);
    };
    check_only(with_noise(R"({ "x": { "sd": 0.5, "correlation": 1.0 } })"),
               "/data/0/simulate/noise/x/correlation: must be > -1 and < 1");
    check_only(with_noise(R"({ "x": { "correlation": 0.5 } })"), "/data/0/simulate/noise/x");
    check_only(with_noise(R"({ "x": { "sd": -0.5 } })"), "/data/0/simulate/noise/x/sd");
    check_only(with_noise(R"({ "x": "much" })"), "/data/0/simulate/noise/x");
}

TEST_CASE("waveform residuals are refused where they cannot be meant", "[apps][waveform]") {
    CHECK(problems(spring_job().dump(1)).empty());
    const std::string at = "/estimate/residuals/0";
    check_refused({{"period", 0}}, at + "/period");
    check_refused({{"period", {{"nowhere", 1}, {"slow", 1}}}}, at + "/period/nowhere: \"nowhere\" is no experiment");
    check_refused({{"period", "long"}}, at + "/period");
    check_refused({{"time", 3.0}}, at + "/time: the model duffing is forced");
    check_refused({{"phase", 7.0}}, at + "/phase: must be within +- 6.28");
    check_refused({{"phase", {{"slow", 0.1}, {"fast", -7.0}}}}, at + "/phase/fast: must be within +- 6.28");
    check_refused({{"phase", "given"}}, at + "/phase");
    check_refused({{"phase", json::array()}}, at + "/phase");
    check_refused({{"offset", "maybe"}}, at + "/offset");
    check_refused({{"offset", {{"x_dot", "estimate"}}}}, at + "/offset/x_dot: \"x_dot\" is not observed");
    check_refused({{"offset", {{"x", true}}}}, at + "/offset/x");
    check_refused({{"data", {"slow", "slw"}}}, at + "/data/1: there are no data named \"slw\"; did you mean \"slow\"?");
    check_refused({{"data", json::array()}}, at + "/data: must not be empty");
    check_refused({{"start", {{"slow", {{0.1, 0.0}, {0.1, 0.0}}}}}}, at + "/start/slow: must hold one state");
    check_refused({{"matching", "exact"}}, at + "/matching");

    json cycle = json::parse(R"({
      "model": { "name": "van_der_pol" },
      "data": { "name": "run1", "simulate": { "samples": { "step": 0.1, "count": 300 }, "transient": 400,
                "initial": [[1.0, 0.0]], "noise": { "x": 0.01, "x_dot": 0.01 } } },
      "estimate": { "parameters": { "mu": { "start": 1.2 } }, "residuals": [ { "type": "waveform" } ] } })");
    check_refused({{"time", "soon"}}, at + "/time", cycle);
    check_refused({{"time", 6.6}, {"period", 1}}, at + "/period: the model van_der_pol is not forced", cycle);
    check_refused({{"time", -1.0}}, at + "/time", cycle);
    check_refused({{"time", 6.6}, {"phase", 0.0}}, at + "/phase: must be \"estimate\"", cycle);

    // What only the data can tell.
    const TemporaryFolder folder;
    const auto refused = [&](const json& job, const std::string& expected) {
        const Outcome run = orbid_with(
            {"run", write_job(folder.path() / "job.json", job), "--out", folder.path() / "out", "--quiet", "--force"});
        CAPTURE(run.error);
        CHECK(run.code == 3);
        CHECK_THAT(run.error, ContainsSubstring(expected));
    };
    json job = spring_job();
    job["estimate"]["residuals"][0]["period"] = {{"slow", 1}, {"fast", 8}};
    refused(job, "fast: lasts 30 s, its orbit 41.89 s: at least one whole orbit is needed");
    job["estimate"]["residuals"][0]["period"] = 2;
    refused(job, "slow: no periodic solution at the start: shorter_period; fast: no periodic solution");

    // An autonomous one that is complete.
    cycle["estimate"]["residuals"][0]["time"] = 6.0;
    const Outcome run =
        orbid_with({"run", write_job(folder.path() / "cycle.json", cycle), "--out", folder.path() / "cycle"});
    CAPTURE(run.error);
    REQUIRE(run.code == 0);
    const json result = read_json(folder.path() / "cycle" / "result.json");
    const json& mu = result["parameters"]["mu"];
    CHECK(std::abs(mu["value"].get<double>() - 1.0) < 4.0 * mu["sd"].get<double>());
    // The period of the limit cycle at mu = 1.
    CHECK_THAT(result["steady_states"][0]["time"].get<double>(), WithinRel(6.6632868593, 1e-3));
}

/// Two wells: at gamma = 0.28 the motion repeats after two periods, if the damping is below 0.4.
json wells_job(int period) {
    return json::parse(R"({
      "model": { "name": "duffing", "parameters": { "delta": 0.3, "alpha": -1.0, "beta": 1.0, "omega": 1.2 } },
      "data": [
        { "name": "single", "parameters": { "gamma": 0.2 }, "observe": ["x"],
          "simulate": { "samples": { "step": 0.25, "count": 120 }, "transient": 800, "initial": [[1.0, 0.0]],
                        "noise": { "x": 0.001 } } },
        { "name": "double", "parameters": { "gamma": 0.28 }, "observe": ["x"],
          "simulate": { "samples": { "step": 0.25, "count": 120 }, "transient": 800, "initial": [[1.0, 0.0]],
                        "noise": { "x": 0.001 } } } ],
      "estimate": { "parameters": { "delta": { "start": 0.45 } },
                    "residuals": [ { "type": "waveform", "period": { "single": 1, "double": )" +
                       std::to_string(period) + R"( } } ] },
      "output": { "series": "none" } })");
}

TEST_CASE("a record without an orbit at the start is sought again at the end", "[apps][run][waveform]") {
    const TemporaryFolder folder;
    const Path out = folder.path() / "out";
    const Outcome run = orbid_with({"run", write_job(folder.path() / "job.json", wells_job(2)), "--out", out});
    CAPTURE(run.error, run.out);
    CHECK_THAT(run.error, ContainsSubstring("double: no periodic solution at the start"));
    REQUIRE(run.code == 0);
    const json result = read_json(out / "result.json");
    CHECK(result["residuals"][0]["used"] == 2);
    CHECK(result["residuals"][0]["added"] == 1);
    CHECK(result["residuals"][0]["unused"].empty());
    const json& delta = result["parameters"]["delta"];
    CHECK(std::abs(delta["value"].get<double>() - 0.3) < 4.0 * delta["sd"].get<double>());
}

TEST_CASE("records that stay lost are named and lower the verdict", "[apps][run][waveform]") {
    const TemporaryFolder folder;
    const Path out = folder.path() / "out";
    // There is no orbit of three periods.
    const Outcome run = orbid_with({"run", write_job(folder.path() / "job.json", wells_job(3)), "--out", out});
    CAPTURE(run.error, run.out);
    CHECK(run.code == 1);
    const std::string said = "1 of 2 records is not used: waveform, double";
    CHECK_THAT(run.out, ContainsSubstring(said) && ContainsSubstring("Too few are left"));
    const json result = read_json(out / "result.json");
    CHECK(result["status"] == "converged");
    CHECK_THAT(result["message"].get<std::string>(), ContainsSubstring(said));
    CHECK(result["residuals"][0]["unused"] == json({"waveform, double"}));
    CHECK(result["steady_states"][1]["used"] == false);
    CHECK_THAT(orbid::apps::read_whole_file(out / "report.html"),
               ContainsSubstring("Not usable") && ContainsSubstring("converged on 50 % of the records only"));
}

}  // namespace waveform_run_test
