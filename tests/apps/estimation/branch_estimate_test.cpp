// Jobs that estimate from amplitudes and frequencies over a parameter: a branch of Duffing's oscillator with its folds.
#include <cmath>
#include <fstream>
#include <sstream>
#include <string>
#include <utility>

#include <fmt/format.h>

#include "models/catalogue/registry.hpp"
#include "periodic/branches/continuation.hpp"
#include "tests/apps/program/program.hpp"
#include "tests/catch.hpp"
#include "tests/source_folder.hpp"

namespace branch_estimate_test {

using namespace orbid;
using namespace orbid::tests;

namespace {

const char* const head = R"({ "model": { "name": "duffing",
  "parameters": { "alpha": 1, "omega": 1.2, "beta": 0.3, "gamma": 0.4, "delta": 0.1 } },)";

/// A row per orbit of the true branch at these frequencies, in tenths of the amplitude.
std::string measured_branch() {
    const auto system = models::make_system("duffing", "");
    Eigen::VectorXd values = system->default_parameters();
    const auto set = [&](const char* name, double value) { values[system->parameter_index(name)] = value; };
    set("alpha", 1.0);
    set("omega", 1.2);
    set("beta", 0.3);
    set("gamma", 0.4);
    set("delta", 0.1);
    periodic::StartingSolution start;
    start.points = Eigen::Vector2d(1.6, 0.4);
    periodic::ContinuationOptions options;
    options.parameter = system->parameter_index("omega");
    options.lower = 1.0;
    options.upper = 1.7;
    options.first_step = 1e-3;
    options.largest_step = 2e-3;
    options.solver.maximum_distance = 10.0;
    options.maximum_points = 20000;
    const auto diagram = periodic::follow_branches(*system, values, start, options);
    REQUIRE(diagram.branches.size() == 1);
    std::ostringstream table;
    table.precision(17);
    table << "w,a,v\n";
    int rows = 0;
    const auto& points = diagram.branches[0].points;
    for (std::size_t k = 20; k + 1 < points.size(); k += 60, ++rows)
        table << points[k].parameter << ',' << 10.0 * points[k].amplitude.half_range(0) << ','
              << (rows == 2 ? std::string() : fmt::format("{}", points[k].amplitude.rms(1))) << '\n';
    REQUIRE(rows >= 6);
    return table.str();
}

std::string job_text(const std::string& more = "") {
    return std::string(head) + R"(
  "estimate": {
    "parameters": { "delta": { "start": 0.103 }, "beta": { "start": 0.29 }, "gamma": { "start": 0.41 } },
    "residuals": [ { "type": "branch", "file": "table.csv", "parameter": "omega",
      "columns": { "omega": "w", "x.half_range": { "column": "a", "factor": 0.1 }, "x_dot.rms": "v" },
      "orbit": { "period": 1, "points": [[1.6, 0.4]] })" +
           more + R"( } ] } })";
}

}  // namespace

TEST_CASE("a branch with its folds gives the parameters back", "[apps][run]") {
    TemporaryFolder folder;
    write_text(folder.path() / "table.csv", measured_branch());
    const Path job = write_text(folder.path() / "job.json", job_text());
    const Path out = folder.path() / "out";
    const Outcome outcome = orbid_with({"run", job, "--out", out});
    CAPTURE(outcome.out, outcome.error);
    REQUIRE(outcome.code == 0);
    const json result = read_json(out / "result.json");
    CHECK(result["status"] == "converged");
    for (const auto& [name, truth] : {std::pair{"delta", 0.1}, std::pair{"beta", 0.3}, std::pair{"gamma", 0.4}})
        CHECK_THAT(result["parameters"][name]["value"].get<double>(), WithinAbs(truth, 1e-7));
    CHECK(result["errors"].contains("branch.x.half_range"));
    const json& states = result["steady_states"];
    std::size_t unstable = 0, used = 0;
    for (const json& state : states) {
        used += state["used"] == true ? 1 : 0;
        CHECK(state["experiment"] == "branch");
        CHECK_FALSE(state.contains("phase"));
        bool grows = false;
        for (const json& one : state["multipliers"])
            grows = grows || std::hypot(one[0].get<double>(), one[1].get<double>()) > 1.0;
        unstable += grows ? 1 : 0;
    }
    // At the fold itself there may be no orbit, to rounding.
    CHECK(used + 1 >= states.size());
    CHECK(unstable > 0);
    CHECK(unstable < states.size());
    std::ifstream rows(out / "residuals.csv");
    std::size_t lines = 0;
    for (std::string line; std::getline(rows, line);)
        ++lines;
    CHECK(lines == 2 * used);  // the header, and one measure is missing
    CHECK(orbid_with({"report", out}).code == 0);
    // The stored job is the same job.
    const Outcome again = orbid_with({"run", out / "job.json", "--out", folder.path() / "again"});
    CHECK(again.code == 0);
    CHECK(read_json(folder.path() / "again" / "result.json")["parameters"] == result["parameters"]);
}

TEST_CASE("formulas are measured along a branch, which is left behind with the motions", "[apps][run]") {
    TemporaryFolder folder;
    write_text(folder.path() / "table.csv", measured_branch());
    std::string text = job_text(R"(, "readings": { "twice": { "formula": "2 * x", "unit": "m" } },
      "errors": { "twice.half_range": { "distribution": "lognormal", "sd": 0.05 } })");
    const std::string plain = R"("x.half_range": { "column": "a", "factor": 0.1 })";
    text.replace(text.find(plain), plain.size(), R"("twice.half_range": { "column": "a", "factor": 0.2 })");
    const Path job = write_text(folder.path() / "job.json", text);
    const Path out = folder.path() / "out";
    const Outcome outcome = orbid_with({"run", job, "--out", out});
    CAPTURE(outcome.out, outcome.error);
    REQUIRE(outcome.code == 0);
    const json result = read_json(out / "result.json");
    CHECK(result["errors"].contains("branch.twice.half_range"));
    for (const auto& [name, truth] : {std::pair{"delta", 0.1}, std::pair{"beta", 0.3}, std::pair{"gamma", 0.4}})
        CHECK_THAT(result["parameters"][name]["value"].get<double>(), WithinAbs(truth, 1e-6));

    const json branch = read_json(out / "branch.json");
    CHECK(branch["readings"][0]["name"] == "twice");
    CHECK(branch["readings"][0]["unit"] == "m");
    REQUIRE(branch["branches"].size() == 1);
    CHECK(branch["branches"][0]["piece"] == "the start");
    std::size_t folds = 0;
    for (const json& point : branch["branches"][0]["points"]) {
        const json& half_range = point["amplitude"]["half_range"];
        REQUIRE(half_range.size() == 3);
        CHECK_THAT(half_range[2].get<double>(), WithinRel(2.0 * half_range[0].get<double>(), 1e-12));
        folds += point["bifurcation"] == "fold" ? 1 : 0;
    }
    CHECK(folds == 2);
    std::size_t unstable = 0;
    for (const json& motion : branch["measured"]) {
        if (!motion["used"]) continue;
        unstable += motion["unstable"] == 0 ? 0 : 1;
        const json& value = motion["values"][0];
        CHECK(value["name"] == "twice.half_range");
        // The errors are log-normal: 5 % of what is predicted.
        CHECK_THAT(value["sd"].get<double>(), WithinRel(0.05 * value["predicted"].get<double>(), 1e-9));
        CHECK_THAT(value["observed"].get<double>(), WithinRel(value["predicted"].get<double>(), 1e-6));
    }
    CHECK(unstable > 0);
    CHECK(unstable < branch["measured"].size());
    const std::string table = apps::read_whole_file(out / "branch.csv");
    CHECK_THAT(table, ContainsSubstring(",twice_half_range,") && ContainsSubstring(",piece\n"));
    CHECK_THAT(apps::read_whole_file(out / "branch.svg"), ContainsSubstring("twice.half_range"));
    const Outcome plot = orbid_with({"plot", out, "branch", "--out", "-"});
    CHECK(plot.code == 0);
    CHECK_THAT(plot.out, ContainsSubstring("measured, unstable") && ContainsSubstring("x_dot.rms"));

    const auto refused = [&](const std::string& from, const std::string& to) {
        std::string wrong = text;
        wrong.replace(wrong.find(from), from.size(), to);
        const Outcome said = orbid_with({"check", write_text(folder.path() / "wrong.json", wrong)});
        CHECK(said.code == 2);
        return said.error + said.out;
    };
    CHECK_THAT(refused(R"("twice": {)", R"("x": {)"), ContainsSubstring("is the name of something else already"));
    CHECK_THAT(refused("2 * x", "2 * y"), ContainsSubstring("/readings/twice/formula"));
    CHECK_THAT(refused(R"("twice.half_range": { "c)", R"("twice.halfrange": { "c)"),
               ContainsSubstring("twice.half_range"));
}

TEST_CASE("the parameter of a branch may have errors, and keeps the motion at the fold", "[apps][run]") {
    TemporaryFolder folder;
    write_text(folder.path() / "table.csv", measured_branch());
    const std::string errors =
        R"(, "errors": { "omega": { "sd": 1e-3 }, "x.half_range": { "sd": 1e-3 }, "x_dot.rms": { "sd": 1e-3 } })";
    const Path job = write_text(folder.path() / "job.json", job_text(errors));
    const Path out = folder.path() / "out";
    const Outcome outcome = orbid_with({"run", job, "--out", out});
    CAPTURE(outcome.out, outcome.error);
    REQUIRE(outcome.code == 0);
    const json result = read_json(out / "result.json");
    for (const auto& [name, truth] : {std::pair{"delta", 0.1}, std::pair{"beta", 0.3}, std::pair{"gamma", 0.4}})
        CHECK_THAT(result["parameters"][name]["value"].get<double>(), WithinAbs(truth, 1e-7));
    CHECK_THAT(result["errors"]["branch.omega"]["sd"].get<double>(), WithinAbs(1e-3, 1e-15));
    std::size_t motions = 0;
    for (const json& state : result["steady_states"]) {
        ++motions;
        CHECK(state["used"] == true);
    }
    std::ifstream rows(out / "residuals.csv");
    std::size_t lines = 0, of_parameter = 0;
    for (std::string line; std::getline(rows, line); ++lines)
        of_parameter += line.find(",omega,") != std::string::npos ? 1 : 0;
    CHECK(of_parameter == motions);
    CHECK(lines == 3 * motions);  // the header, and one measure is missing
    const Outcome again = orbid_with({"run", out / "job.json", "--out", folder.path() / "again"});
    CHECK(again.code == 0);
    CHECK(read_json(folder.path() / "again" / "result.json")["parameters"] == result["parameters"]);
}

TEST_CASE("errors of the parameter of a branch need a known sd", "[apps][run]") {
    TemporaryFolder folder;
    write_text(folder.path() / "table.csv", "w,a,v\n1.2,1,1\n");
    for (const char* error : {R"({ "sd": "estimate" })", R"({ "distribution": "student_t", "sd": 0.1 })"}) {
        const Path job =
            write_text(folder.path() / "job.json", job_text(fmt::format(R"(, "errors": {{ "omega": {} }})", error)));
        const Outcome outcome = orbid_with({"check", job});
        CAPTURE(error);
        CHECK(outcome.code == 2);
        CHECK_THAT(outcome.error + outcome.out, ContainsSubstring("the parameter has normal errors of a known sd"));
    }
}

TEST_CASE("a branch is compared with the model as it is, without free parameters", "[apps][run]") {
    TemporaryFolder folder;
    write_text(folder.path() / "table.csv", measured_branch());
    std::string text = job_text();
    const std::string free = R"("delta": { "start": 0.103 }, "beta": { "start": 0.29 }, "gamma": { "start": 0.41 })";
    text.replace(text.find(free), free.size(), "");
    const Outcome outcome = orbid_with({"run", write_text(folder.path() / "job.json", text)});
    CAPTURE(outcome.out, outcome.error);
    REQUIRE(outcome.code == 0);
    const json result = read_json(folder.path() / "job" / "result.json");
    CHECK(result["status"] == "converged");
    // The table was made with the model's own values.
    CHECK(result["errors"]["branch.x.half_range"]["rms"].get<double>() < 1e-8);
}

TEST_CASE("branches that cannot be used say why", "[apps][run]") {
    TemporaryFolder folder;
    const auto said = [&](const std::string& table, const std::string& text) {
        write_text(folder.path() / "table.csv", table);
        const Path job = write_text(folder.path() / "job.json", text);
        const Outcome outcome = orbid_with({"run", job, "--out", folder.path() / "out", "--force"});
        CHECK(outcome.code == 3);
        return outcome.error;
    };
    CHECK_THAT(said("w,b,v\n1.2,1,1\n", job_text()), ContainsSubstring("no column \"a\""));
    CHECK_THAT(said("w,a,v\n,1,1\n", job_text()), ContainsSubstring("a value of omega is missing"));
    CHECK_THAT(said("w,a,v\n1.2,,\n1.3,1,1\n", job_text()), ContainsSubstring("omega = 1.2: nothing is measured"));
    CHECK_THAT(said("w,a,v\n9,1,1\n9.1,1,1\n9.2,1,1\n", job_text(R"(, "range": [1.1, 1.3])")),
               ContainsSubstring("branch") && ContainsSubstring("omega = 9"));
    std::string text = job_text();
    text.replace(text.find("[[1.6, 0.4]]"), 12, "[[1e9, 1e9]]");
    CHECK_THAT(said("w,a,v\n1.2,10,1\n1.3,10,1\n1.4,10,1\n", text),
               ContainsSubstring("branch: no branch begins at the given orbit"));
}

TEST_CASE("a job with a continuation of its own keeps it apart from the fitted branch", "[apps][run]") {
    TemporaryFolder folder;
    write_text(folder.path() / "table.csv", measured_branch());
    std::string text = job_text();
    text.insert(text.rfind('}'), R"(, "periodic": { "orbits": [ { "period": 1, "points": [[1.6, 0.4]] } ],
        "continuation": { "parameter": "omega", "range": [1.1, 1.3], "plot": "x_dot.rms" } })");
    const Path job = write_text(folder.path() / "job.json", text);
    const Path out = folder.path() / "out";
    const Outcome outcome = orbid_with({"run", job, "--out", out});
    CAPTURE(outcome.out, outcome.error);
    REQUIRE(outcome.code == 0);
    CHECK(read_json(out / "branch.json")["parameter"]["range"] == json({1.1, 1.3}));
    CHECK_FALSE(read_json(out / "branch.json").contains("measured"));
    CHECK(read_json(out / "estimate_branch.json")["measured"].size() > 5);
    CHECK_THAT(apps::read_whole_file(out / "branch.svg"), ContainsSubstring("x_dot.rms"));
    CHECK_THAT(apps::read_whole_file(out / "estimate_branch.svg"), ContainsSubstring("x.half_range"));
    CHECK(read_json(out / "job.json")["periodic"]["continuation"]["plot"] == "x_dot.rms");
    text.replace(text.find("x_dot.rms\" } }"), 9, "x_dit.rms");
    const Outcome wrong = orbid_with({"check", write_text(folder.path() / "wrong.json", text)});
    CHECK(wrong.code == 2);
    CHECK_THAT(wrong.error + wrong.out, ContainsSubstring("/periodic/continuation/plot"));
}

}  // namespace branch_estimate_test
