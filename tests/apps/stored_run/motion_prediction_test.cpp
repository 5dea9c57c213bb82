// Questions on periodic motions after an estimate from some of them: Duffing's oscillator, fitted to its stable orbits,
// asked for the unstable ones.
#include <cmath>
#include <sstream>
#include <string>

#include <fmt/format.h>

#include "models/catalogue/registry.hpp"
#include "periodic/branches/continuation.hpp"
#include "tests/apps/program/program.hpp"
#include "tests/catch.hpp"

namespace motion_prediction_test {

using namespace orbid;
using namespace orbid::tests;

namespace {

/// The orbits of the true branch, stable or not, with amplitudes that are 1 % too large and too small in turn.
std::string measured_orbits(bool stable) {
    const auto system = models::make_system("duffing", "");
    Eigen::VectorXd values = system->default_parameters();
    for (const auto& [name, value] : {std::pair{"alpha", 1.0}, std::pair{"omega", 1.2}, std::pair{"beta", 0.3},
                                      std::pair{"gamma", 0.4}, std::pair{"delta", 0.1}})
        values[system->parameter_index(name)] = value;
    periodic::StartingSolution start;
    start.points = Eigen::Vector2d(1.6, 0.4);
    periodic::ContinuationOptions options;
    options.parameter = system->parameter_index("omega");
    options.lower = 1.0;
    options.upper = 1.7;
    options.first_step = 1e-3;
    options.largest_step = 5e-3;
    options.solver.maximum_distance = 10.0;
    const auto diagram = periodic::follow_branches(*system, values, start, options);
    REQUIRE(diagram.branches.size() == 1);
    std::ostringstream table;
    table.precision(17);
    table << "w,a\n";
    int rows = 0;
    const auto& points = diagram.branches[0].points;
    for (std::size_t k = 10; k + 1 < points.size(); k += 25) {
        if ((points[k].unstable == 0) != stable) continue;
        table << points[k].parameter << ',' << points[k].amplitude.half_range(0) * (rows % 2 == 0 ? 1.01 : 0.99)
              << '\n';
        ++rows;
    }
    REQUIRE(rows >= 3);
    return table.str();
}

const char* const fit = R"({ "model": { "name": "duffing",
  "parameters": { "alpha": 1, "omega": 1.2, "beta": 0.3, "gamma": 0.4, "delta": 0.1 } },
  "estimate": {
    "parameters": { "delta": { "start": 0.103, "scale": "log" }, "gamma": { "start": 0.41, "scale": "log" } },
    "residuals": [ { "type": "branch", "file": "stable.csv", "parameter": "omega",
      "columns": { "omega": "w", "x.half_range": "a" },
      "orbit": { "period": 1, "points": [[1.6, 0.4]] },
      "errors": { "x.half_range": { "distribution": "lognormal" } } } ] } })";

/// A run fitted to the stable orbits.
struct FittedRun {
    TemporaryFolder folder;
    Path out = folder.path() / "out";

    FittedRun() {
        write_text(folder.path() / "stable.csv", measured_orbits(true));
        write_text(folder.path() / "unstable.csv", measured_orbits(false));
        const Outcome outcome =
            orbid_with({"run", write_text(folder.path() / "fit.json", fit), "--out", out, "--quiet"});
        CAPTURE(outcome.error);
        REQUIRE(outcome.code == 0);
    }
    Outcome ask(const std::string& question, const std::string& name = "question") const {
        return orbid_with({"predict", out, write_text(folder.path() / (name + ".json"), question), "--quiet"});
    }
};

}  // namespace

TEST_CASE("a fit to stable orbits predicts unstable ones within its bands", "[apps][predict]") {
    const FittedRun run;
    // A table alone: parameter, columns and orbit are those of the run.
    const Outcome outcome = orbid_with({"predict", run.out, run.folder.path() / "unstable.csv", "--quiet"});
    CAPTURE(outcome.out, outcome.error);
    REQUIRE(outcome.code == 0);
    CHECK_THAT(outcome.out, ContainsSubstring("200 draws from the normal approximation") && ContainsSubstring("fold") &&
                                ContainsSubstring("unstable"));
    const Path folder = run.out / "predict_unstable";
    const json prediction = read_json(folder / "prediction.json");
    CHECK(prediction["kind"] == "periodic");
    CHECK(prediction["posterior"]["draws"] == 200);
    CHECK(prediction["posterior"]["parameters"] == json({"delta", "gamma"}));
    REQUIRE(prediction["measured"].size() >= 3);
    std::size_t stable = 0;
    for (const json& row : prediction["measured"]) {
        CHECK(row["measure"] == "x.half_range");
        stable += row["is_stable"] == true ? 1 : 0;
        // Errors of 1 %, their sd estimated from as many stable orbits: all of them within prediction and error.
        CHECK(row["inside_with_errors"] == true);
        CHECK(std::abs(row["relative_error"].get<double>()) < 0.04);
        CHECK(row["sd"].get<double>() > 0.0);
        CHECK(row["interval95"][0].get<double>() < row["predicted"].get<double>());
        CHECK(row["interval95"][1].get<double>() > row["predicted"].get<double>());
    }
    // Beside the fold an error of 1 % reaches the stable orbit.
    CHECK(stable <= 1);
    std::size_t folds = 0;
    for (const json& mark : prediction["branch"]["marks"])
        folds += mark["kind"] == "fold" ? 1 : 0;
    CHECK(folds == 2);
    // The points of branch.json have the bands of prediction.json, in this order; so has the table.
    const json branch = read_json(folder / "branch.json");
    const json& points = branch["branches"][0]["points"];
    REQUIRE(points.size() == prediction["branch"]["points"].size());
    for (std::size_t k = 0; k < points.size(); ++k)
        CHECK(prediction["branch"]["points"][k]["quantities"]["x.half_range"]["value"] ==
              points[k]["amplitude"]["half_range"][0]);
    CHECK(branch["measured"].size() == prediction["measured"].size());
    CHECK_THAT(apps::read_whole_file(folder / "branch.csv"),
               ContainsSubstring(",x_half_range_sd,x_half_range_lower95,x_half_range_upper95,"));
    const Outcome plot = orbid_with({"plot", folder, "branch", "--out", "-"});
    CHECK(plot.code == 0);
    CHECK_THAT(plot.out, ContainsSubstring("95 % band") && ContainsSubstring("measured, unstable"));
    CHECK_THAT(apps::read_whole_file(folder / "report.html"), ContainsSubstring("95 % band"));
    // The same again, with another number of threads.
    const Outcome again = orbid_with({"predict", run.out, run.folder.path() / "unstable.csv", "--quiet", "--threads",
                                      "1", "--out", run.folder.path() / "again"});
    CHECK(again.code == 0);
    CHECK(read_json(run.folder.path() / "again" / "prediction.json") == prediction);
}

TEST_CASE("orbits are predicted at other parameters, by draws and by the delta method", "[apps][predict]") {
    const FittedRun run;
    const std::string orbits = R"("periodic": { "orbits": [ { "period": 1, "points": [[1.6, 0.4]] } ] },
        "at": [ {}, { "omega": 1.1 }, { "omega": 1.15, "beta": 0.25 } ])";
    const Outcome draws = run.ask("{" + orbits + R"(, "bands": { "draws": 100, "seed": 3 } })", "draws");
    CAPTURE(draws.out, draws.error);
    REQUIRE(draws.code == 0);
    const Outcome delta = run.ask("{" + orbits + R"(, "bands": { "method": "delta" } })", "delta");
    REQUIRE(delta.code == 0);
    CHECK_THAT(delta.out, ContainsSubstring("the delta method"));
    const json by_draws = read_json(run.out / "predict_draws" / "prediction.json")["orbits"];
    const json by_delta = read_json(run.out / "predict_delta" / "prediction.json")["orbits"];
    REQUIRE(by_draws.size() == 3);
    for (std::size_t i = 0; i < 3; ++i) {
        CAPTURE(i);
        CHECK(by_draws[i]["status"] == "converged");
        CHECK(by_draws[i]["found"] == 100);
        CHECK(by_draws[i]["stable"] == 1.0);
        const json& a = by_draws[i]["quantities"]["x.half_range"];
        const json& b = by_delta[i]["quantities"]["x.half_range"];
        CHECK(a["value"] == b["value"]);
        CHECK(a["delta_sd"] == b["sd"]);
        // Far from folds both agree, to the error of the sd of 100 draws (7 %, three of them) and its curvature.
        CHECK_THAT(a["sd"].get<double>(), WithinRel(b["sd"].get<double>(), 0.3));
        CHECK(by_draws[i]["points"][0].size() == 2);
    }
    CHECK(by_draws[1]["at"]["omega"] == 1.1);
    CHECK_THAT(by_draws[1]["quantities"]["frequency"]["value"].get<double>(),
               WithinRel(1.1 / (2.0 * std::acos(-1.0)), 1e-12));
}

TEST_CASE("questions that cannot be answered say why", "[apps][predict]") {
    const FittedRun run;
    const auto said = [&](const std::string& question, int code = 2) {
        const Outcome outcome = run.ask(question);
        CHECK(outcome.code == code);
        return outcome.error;
    };
    const std::string orbits = R"("orbits": [ { "period": 1, "points": [[1.6, 0.4]] } ])";
    CHECK_THAT(said(R"({ "periodic": {)" + orbits + R"(}, "bands": { "draw": 10 } })"),
               ContainsSubstring("/bands/draw: unknown key") && ContainsSubstring("draws"));
    CHECK_THAT(said(R"({ "periodic": {)" + orbits + R"(}, "bands": { "draws": 1 } })"),
               ContainsSubstring("/bands/draws: must be a whole number in [2, 100000], not 1"));
    CHECK_THAT(said(R"({ "periodic": {)" + orbits + R"(}, "at": [ { "omgea": 1 } ] })"),
               ContainsSubstring("/at/0/omgea: unknown key") && ContainsSubstring("omega"));
    CHECK_THAT(
        said(R"({ "periodic": {)" + orbits + R"(, "continuation": { "parameter": "omega", "range": [2, 3] } } })"),
        ContainsSubstring("/periodic/continuation/range: must contain the value"));
    CHECK_THAT(said(R"({ "periodic": {)" + orbits + R"(, "search": { "periods": [1] } } })"),
               ContainsSubstring("/periodic/search: unknown key"));
    CHECK_THAT(said(R"({ "periodic": { "orbits": [ { "period": 1, "points": [[1.6]] } ] } })"),
               ContainsSubstring("/periodic/orbits/0/points/0"));
    CHECK_THAT(said(R"({ "measured": { "file": "none.csv" } })"), ContainsSubstring("/measured/file"));
    CHECK_THAT(said(R"({ "measured": { "file": "unstable.csv", "columns": { "y.rms": "a" } } })"),
               ContainsSubstring("/measured/columns/y.rms"));
    // A table is read before the draws, which may take minutes: nothing is written.
    write_text(run.folder.path() / "lacking.csv", "w\n1.2\n");
    CHECK_THAT(said(R"({ "measured": { "file": "lacking.csv" }, "bands": { "draws": 100000 } })", 3),
               ContainsSubstring("lacking.csv: no column"));
    // A run of orbits alone has no estimate.
    const Path job =
        write_text(run.folder.path() / "job.json",
                   R"({ "model": { "name": "duffing", "parameters": { "alpha": 1, "omega": 1.2, "beta": 0.3,
                                    "gamma": 0.4, "delta": 0.1 } }, "periodic": {)" +
                       orbits + "} }");
    REQUIRE(orbid_with({"run", job, "--quiet"}).code == 0);
    const Outcome none = orbid_with({"predict", run.folder.path() / "job", run.folder.path() / "question.json"});
    CHECK(none.code == 2);
    CHECK_THAT(none.error, ContainsSubstring("holds no estimate"));
}

}  // namespace motion_prediction_test
