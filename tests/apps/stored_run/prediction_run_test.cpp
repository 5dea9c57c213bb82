// orbid predict: from a stored estimate and a further record to errors and horizons.

#include <cmath>

#include <fmt/format.h>

#include "tests/apps/program/program.hpp"
#include "tests/catch.hpp"

namespace prediction_run_test {

using namespace orbid::tests;

namespace {

/// A driven pendulum-like oscillator in one well: not chaotic, so that a forecast holds to the end.
json duffing_job(int seed, double start) {
    json job = json::parse(R"({
      "model": { "name": "duffing" },
      "data": { "name": "swing", "simulate": { "samples": { "step": 0.05, "count": 401 }, "trajectories": 2,
                  "initial": [[1.0, 1.0], [0.5, 0.0]], "noise": { "x": 0.01, "x_dot": 0.02 } } },
      "estimate": { "parameters": { "delta": { "start": 0.33 } }, "residuals": [ { "type": "series" } ] },
      "output": { "series": "csv" } })");
    job["seed"] = seed;
    job["data"]["simulate"]["initial"][0][0] = start;
    return job;
}

/// An estimate, and the table of another record of the same system.
struct Runs {
    TemporaryFolder folder;
    Path run = folder.path() / "run";
    Path record = folder.path() / "further.csv";

    Runs() {
        REQUIRE(orbid_with({"run", write_job(folder.path() / "run.json", duffing_job(3, 1.0)), "--out", run}).code ==
                0);
        const Path other = folder.path() / "other";
        REQUIRE(orbid_with({"simulate", write_job(folder.path() / "other.json", duffing_job(8, 0.9)), "--out", other})
                    .code == 0);
        std::filesystem::copy_file(other / "series.csv", record);
    }
};

}  // namespace

TEST_CASE("a further record of the same system is predicted to the errors of its readings", "[apps][predict]") {
    const Runs runs;
    const Outcome outcome = orbid_with({"predict", runs.run, runs.record});
    CAPTURE(outcome.error, outcome.out);
    REQUIRE(outcome.code == 0);
    const Path out = runs.run / "predict_further";
    const json prediction = read_json(out / "prediction.json");
    CHECK(prediction["format"] == "orbid-prediction/1");
    CHECK(prediction["known_errors"] == true);
    REQUIRE(prediction["segments"].size() == 2);
    for (const json& segment : prediction["segments"]) {
        CHECK(segment["message"].is_null());
        CHECK(segment["readings"] == 802);
        // 802 readings: an rms of true errors is 1 to 1 / sqrt(2 * 802) = 2.5 %, and the scale is known to as much;
        // four of both together.
        CHECK_THAT(segment["course"]["normalised_rms"].get<double>(), WithinAbs(1.0, 0.15));
        CHECK_THAT(segment["course"]["rms"]["x"].get<double>(), WithinRel(0.01, 0.2));
        // 40 samples are a tenth: the rest is 18 s long, and errors of the beginning do not grow.
        CHECK_THAT(segment["ahead"]["beginning"].get<double>(), WithinAbs(1.95, 1e-9));
        CHECK(segment["ahead"]["covered"].get<int>() > 600);
        // 95 % of 722 readings have an sd of 0.8 %; errors of the beginning are common to them all, so ten of that.
        CHECK_THAT(segment["ahead"]["coverage95"].get<double>(), WithinAbs(0.95, 0.08));
    }
    CHECK_THAT(outcome.out, ContainsSubstring("further.csv predicted by") && ContainsSubstring("within 2 sds for"));
    // The folder is a run: it can be plotted, and its job repeats the fit with the parameters held.
    CHECK_THAT(orbid_with({"plot", out}).out, ContainsSubstring("prediction"));
    const json job = read_json(out / "job.json");
    CHECK(job["estimate"]["parameters"].empty());
    CHECK(job["model"]["parameters"]["delta"] == read_json(runs.run / "result.json")["parameters"]["delta"]["value"]);
    CHECK(orbid_with({"check", out / "job.json"}).code == 0);
    // Again: the same bytes, with any number of threads.
    const auto before = content(out);
    REQUIRE(orbid_with({"predict", runs.run, runs.record, "--threads", "1"}).code == 0);
    CHECK(content(out) == before);
}

TEST_CASE("a record of another system stands out", "[apps][predict]") {
    const Runs runs;
    json job = duffing_job(9, 1.0);
    job["model"]["parameters"] = {{"delta", 0.45}};
    const Path other = runs.folder.path() / "damped";
    REQUIRE(orbid_with({"simulate", write_job(runs.folder.path() / "damped.json", job), "--out", other}).code == 0);
    const Outcome outcome =
        orbid_with({"predict", runs.run, other / "series.csv", "--out", runs.folder.path() / "prediction"});
    REQUIRE(outcome.code == 0);
    CHECK_THAT(outcome.out, ContainsSubstring("do not describe this record"));
    CHECK(read_json(runs.folder.path() / "prediction" / "prediction.json")["segments"][0]["course"]["normalised_rms"]
              .get<double>() > 1.5);
}

TEST_CASE("a record in another layout comes with its data object", "[apps][predict]") {
    const Runs runs;
    std::string text = orbid::apps::read_whole_file(runs.record);
    // The same numbers under other headers.
    const auto header = text.find("segment,t,x,x_dot");
    REQUIRE(header != std::string::npos);
    text.replace(header, 17, "seg,time,pos,speed");
    write_text(runs.folder.path() / "renamed.csv", text);
    write_text(runs.folder.path() / "renamed.json",
               R"({ "file": "renamed.csv", "kind": "samples",
                    "columns": { "segment": "seg", "time": "time", "x": "pos", "x_dot": "speed" } })");
    REQUIRE(orbid_with({"predict", runs.run, runs.folder.path() / "renamed.json"}).code == 0);
    REQUIRE(orbid_with({"predict", runs.run, runs.record}).code == 0);
    CHECK(read_json(runs.run / "predict_renamed" / "prediction.json") ==
          read_json(runs.run / "predict_further" / "prediction.json"));
}

/// A first-order lag of which an input of its own table is known; started where the run says.
json lag_job(int seed, const std::string& input) {
    json job = json::parse(R"({
      "model": { "equations": { "x": "-k * x + u" }, "inputs": { "u": "1" }, "parameters": { "k": 1.5 } },
      "data": { "name": "lag", "simulate": { "samples": { "step": 0.05, "count": 201 }, "initial": [[0.2]],
                  "noise": { "x": 0.001 } }, "inputs": { "time": "t", "u": "u" },
                "initial_state": { "x": { "start": 0.25, "bounds": [-3, 3] } } },
      "estimate": { "parameters": { "k": { "start": 1.3 } },
                    "residuals": [ { "type": "series", "interval": "segment" } ] },
      "output": { "series": "csv" } })");
    job["seed"] = seed;
    job["data"]["inputs"]["file"] = input;
    return job;
}

Path write_input(const Path& file, double frequency) {
    std::string text = "t,u\n";
    for (int k = 0; k <= 220; ++k)
        text += std::to_string(0.05 * k) + "," + std::to_string(std::sin(frequency * 0.05 * k)) + "\n";
    return write_text(file, text);
}

TEST_CASE("a record is driven by its own input, never by that of the run", "[apps][predict]") {
    const TemporaryFolder folder;
    write_input(folder.path() / "first.csv", 1.0);
    std::filesystem::create_directory(folder.path() / "new");
    const Path second = write_input(folder.path() / "new" / "second.csv", 2.3);
    const Path run = folder.path() / "run";
    REQUIRE(orbid_with({"run", write_job(folder.path() / "run.json", lag_job(3, "first.csv"))}).code == 0);
    const Path other = folder.path() / "other";
    REQUIRE(orbid_with({"simulate", write_job(folder.path() / "other.json", lag_job(4, "new/second.csv"))}).code == 0);
    const Path record = folder.path() / "new" / "record.csv";
    std::filesystem::copy_file(other / "series.csv", record);

    const Outcome silent = orbid_with({"predict", run, record});
    CHECK(silent.code == 2);
    CHECK_THAT(silent.error, ContainsSubstring("measured inputs come from a table of their own (first.csv)") ||
                                 ContainsSubstring("first.csv), which belongs to its record: give that of the new"));
    CHECK_THAT(silent.error, ContainsSubstring("--inputs FILE"));

    const Outcome outcome = orbid_with({"predict", run, record, "--inputs", second});
    CAPTURE(outcome.error, outcome.out);
    REQUIRE(outcome.code == 0);
    const json prediction = read_json(run / "predict_record" / "prediction.json");
    // 201 readings: 5 % is the sd of an rms; the error scale as well; three of both.
    CHECK_THAT(prediction["segments"][0]["course"]["normalised_rms"].get<double>(), WithinAbs(1.0, 0.22));
    CHECK(prediction["segments"][0]["message"].is_null());
    const json initial = read_json(run / "predict_record" / "job.json")["data"][0]["initial_state"]["x"];
    CHECK(initial["start"] == 0.25);
    CHECK(initial["bounds"] == json({-3, 3}));

    // The same from a data object: its paths are beside it, wherever the command is given.
    const Path object =
        write_text(folder.path() / "new" / "record.json",
                   R"({ "file": "record.csv", "inputs": { "file": "second.csv", "time": "t", "u": "u" } })");
    REQUIRE(orbid_with({"predict", run, object, "--out", folder.path() / "again", "--quiet"}).code == 0);
    CHECK(read_json(folder.path() / "again" / "prediction.json") == prediction);
    // The page says how far off the prediction is.
    CHECK_THAT(orbid::apps::read_whole_file(folder.path() / "again" / "report.html"),
               ContainsSubstring("How far the record is predicted") && ContainsSubstring("whole segment"));
    CHECK(orbid_with({"predict", run, object, "--out", folder.path() / "again", "--quiet"}).error.empty());
    CHECK_FALSE(orbid_with({"predict", run, object, "--out", folder.path() / "again"}).error.empty());
}

/// x' = -1.5 x + u(t - 0.13) with u = sin(frequency t), settled, read with errors of some 1e-3.
Path write_delayed(const Path& file, double frequency) {
    std::string text = "t,u,x\n";
    for (int k = 0; k <= 400; ++k) {
        const double t = 0.05 * k, angle = frequency * (t - 0.13);
        const double x = (1.5 * std::sin(angle) - frequency * std::cos(angle)) / (1.5 * 1.5 + frequency * frequency);
        text += fmt::format("{:.2f},{:.12f},{:.12f}\n", t, std::sin(frequency * t), x + 1e-3 * std::cos(k * (k + 1.7)));
    }
    return write_text(file, text);
}

TEST_CASE("a record with a delayed input is predicted where its input is known", "[apps][predict]") {
    const TemporaryFolder folder;
    write_delayed(folder.path() / "first.csv", 1.0);
    const Path second = write_delayed(folder.path() / "second.csv", 1.6);
    json job = json::parse(R"({
      "model": { "equations": { "x": "-k * x + u" }, "inputs": { "u": "1" },
                 "parameters": { "k": { "value": 1.3, "unit": "1/s", "domain": "positive" }, "lag": 0.1 } },
      "data": { "name": "rig", "file": "first.csv", "kind": "samples", "columns": { "time": "t", "x": "x" },
                "window": [0.3, 20], "inputs": { "u": "u" }, "interpolation": "cubic", "delay": "lag" },
      "estimate": { "parameters": { "k": {}, "lag": { "bounds": [0, 0.3] } },
                    "residuals": [ { "type": "series", "interval": "segment" } ] } })");
    REQUIRE(orbid_with({"run", write_job(folder.path() / "estimated.json", job)}).code == 0);
    job["data"]["delay"] = 0.13;
    job["model"]["parameters"].erase("lag");
    job["estimate"]["parameters"].erase("lag");
    REQUIRE(orbid_with({"run", write_job(folder.path() / "given.json", job)}).code == 0);
    for (const char* run : {"estimated", "given"}) {
        const Outcome outcome = orbid_with({"predict", folder.path() / run, second});
        CAPTURE(run, outcome.error, outcome.out);
        REQUIRE(outcome.code == 0);
        // Of 401 readings those at 0, 0.05 and 0.1 s have no input 0.13 s before them.
        CHECK_THAT(outcome.error, ContainsSubstring("3 of 401 readings lie before or after what the inputs cover"));
        const json prediction = read_json(folder.path() / run / "predict_second" / "prediction.json");
        CHECK(prediction["segments"][0]["readings"] == 398);
        // The errors' rms is 1e-3 / sqrt 2; what is left of the fitted delay and k is far smaller.
        CHECK_THAT(prediction["segments"][0]["course"]["rms"]["x"].get<double>(),
                   WithinRel(1e-3 / std::sqrt(2.0), 0.1));
        const json made = read_json(folder.path() / run / "predict_second" / "job.json");
        CHECK(made["model"]["parameters"]["k"]["unit"] == "1/s");
        CHECK_THAT(made["model"]["parameters"]["k"]["value"].get<double>(), WithinAbs(1.5, 0.01));
    }
}

TEST_CASE("sections are predicted one step ahead", "[apps][predict]") {
    const TemporaryFolder folder;
    json job = json::parse(R"({ "model": { "name": "henon" }, "seed": 4,
        "data": { "name": "map", "simulate": { "sections": 4000, "noise": { "x": 0.001, "y": 0.001 } } },
        "estimate": { "parameters": { "a": { "start": 1.39 } }, "residuals": [
          { "type": "series", "errors": { "x": { "sd": 0.001 }, "y": { "sd": 0.001 } } } ] },
        "output": { "series": "csv" } })");
    const Path run = folder.path() / "run";
    REQUIRE(orbid_with({"run", write_job(folder.path() / "job.json", job), "--out", run}).code == 0);
    job["seed"] = 5;
    const Path other = folder.path() / "other";
    REQUIRE(orbid_with({"simulate", write_job(folder.path() / "other.json", job), "--out", other}).code == 0);
    const Outcome outcome = orbid_with({"predict", run, other / "series.csv"});
    CAPTURE(outcome.error, outcome.out);
    REQUIRE(outcome.code == 0);
    const json steps = read_json(run / "predict_series" / "prediction.json")["steps"];
    CHECK(steps["count"] == 3999);
    CHECK(steps["failed"] == 0);
    // What the readings' errors become in a step is known exactly: x' = 1 - a x^2 + y, y' = b x.
    CHECK_THAT(steps["normalised_rms"].get<double>(), WithinAbs(1.0, 4.0 / std::sqrt(2.0 * 3999.0)));
    CHECK_THAT(steps["coordinates"]["y"]["expected_rms"].get<double>(),
               WithinRel(0.001 * std::sqrt(1.0 + 0.3 * 0.3), 1e-3));
}

TEST_CASE("predictions that cannot be made are refused", "[apps][predict]") {
    const Runs runs;
    const auto refused = [&](const std::vector<std::string>& arguments, int code) {
        const Outcome outcome = orbid_with(arguments);
        CHECK(outcome.code == code);
        CHECK(outcome.out.empty());
        return outcome.error;
    };
    CHECK_THAT(refused({"predict", runs.run, runs.folder.path() / "none.csv"}, 3), ContainsSubstring("no such file"));
    CHECK_THAT(refused({"predict", runs.run, runs.record, "--experiment", "other"}, 2),
               ContainsSubstring("there is no experiment \"other\"; there are: swing"));
    CHECK_THAT(refused({"predict", runs.folder.path() / "other", runs.record}, 2),
               ContainsSubstring("holds no estimate"));
    CHECK_THAT(refused({"predict", runs.run, write_text(runs.folder.path() / "bad.csv", "t,y\n0,1\n1,2\n")}, 3),
               ContainsSubstring("/data"));
    CHECK_THAT(
        refused({"predict", runs.run, write_text(runs.folder.path() / "bad.json", "{ \"kind\": \"samples\" }")}, 3),
        ContainsSubstring("with \"file\" in it"));
    // Nothing is left behind.
    CHECK_FALSE(std::filesystem::exists(runs.run / "predict_bad"));
}

}  // namespace prediction_run_test
