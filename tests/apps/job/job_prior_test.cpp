#include <filesystem>
#include <string>
#include <vector>

#include "apps/estimation/job_problem.hpp"
#include "apps/job/estimate_job.hpp"
#include "apps/job/reading/job_reader.hpp"
#include "apps/job/writing/job_writer.hpp"
#include "identification/problem/estimate_setup.hpp"
#include "tests/apps/job/job_problems.hpp"
#include "tests/catch.hpp"

namespace job_prior_test {

using namespace orbid;
using namespace orbid::apps;
using estimator::Scale;
using tests::ContainsSubstring;
using tests::job_folder;
using tests::problems;

namespace {

/// A good job with the given parameters, further keys of "estimate" (each followed by a comma), and further keys of
/// two experiments.
std::string job_with(const std::string& parameters, const std::string& estimate = "", const std::string& first = "",
                     const std::string& second = "") {
    return R"({
  "model": { "name": "parametric_pendulum", "variant": "crank" },
  "data": [
    { "name": "run1", )" +
           first + R"("simulate": { "samples": { "step": 0.01, "count": 301 } } },
    { "name": "run2", )" +
           second + R"("simulate": { "samples": { "step": 0.01, "count": 301 } } } ],
  "estimate": { )" +
           estimate + R"(
    "residuals": [ { "type": "series" } ],
    "parameters": { )" +
           parameters + R"( } }
})";
}

Job good(const std::string& text) {
    const auto reading = read_job(text, job_folder / "job.json");
    CAPTURE(problems(text));
    REQUIRE(reading.job);
    return *reading.job;
}

/// One thing is wrong, in the line and at the place with which `beginning` starts.
void check_at(const std::string& text, const std::string& beginning) {
    tests::check_only(text, "job.json:" + beginning);
}

const estimator::FreeParameter& first(const Job& job) {
    return job.estimate->parameters[0].value;
}

/// Reads back to an equal text.
void check_round_trip(const Job& job) {
    const std::string text = job_text(job, job_folder);
    const auto again = read_job(text, job_folder / "job.json");
    CAPTURE(text);
    REQUIRE(again.job);
    CHECK(job_text(*again.job, job_folder) == text);
}

}  // namespace

TEST_CASE("every prior is read and written back", "[apps][job][prior]") {
    const auto read = [](const std::string& prior) {
        const Job job = good(job_with("\"k2\": { \"start\": 1e-3, \"prior\": " + prior + " }"));
        const auto written = job_document(job, job_folder)["estimate"]["parameters"]["k2"]["prior"];
        CHECK(written == nlohmann::ordered_json::parse(prior));
        check_round_trip(job);
        return first(job).prior;
    };
    CHECK(std::holds_alternative<estimator::FlatPrior>(read("\"flat\"")));
    const auto normal = std::get<estimator::NormalPrior>(read(R"({ "normal": { "mean": -1.5, "sd": 0.25 } })"));
    CHECK(normal.mean == -1.5);
    CHECK(normal.sd == 0.25);
    const auto log = std::get<estimator::LogNormalPrior>(read(R"({ "lognormal": { "median": 2.0, "log_sd": 0.5 } })"));
    CHECK(log.median == 2.0);
    CHECK(log.log_sd == 0.5);
    const auto uniform = std::get<estimator::UniformPrior>(read(R"({ "uniform": { "lower": 0.0, "upper": 0.5 } })"));
    CHECK(uniform.upper == 0.5);
    CHECK(std::get<estimator::HalfNormalPrior>(read(R"({ "half_normal": { "scale": 0.125 } })")).scale == 0.125);
    CHECK(std::get<estimator::HalfCauchyPrior>(read(R"({ "half_cauchy": { "scale": 2.5 } })")).scale == 2.5);
    const auto gamma = std::get<estimator::GammaPrior>(read(R"({ "gamma": { "shape": 2.0, "rate": 3.0 } })"));
    CHECK(gamma.shape == 2.0);
    CHECK(gamma.rate == 3.0);
    const auto student =
        std::get<estimator::StudentPrior>(read(R"({ "student_t": { "dof": 4.0, "location": -1.0, "scale": 0.5 } })"));
    CHECK(student.dof == 4.0);
    CHECK(student.location == -1.0);
    CHECK(student.scale == 0.5);
}

TEST_CASE("what is wrong with a prior is named with place and rule", "[apps][job][prior]") {
    const auto wrong = [](const std::string& prior, const std::string& beginning) {
        check_at(job_with("\n\"k2\": { \"start\": 1e-3, \"prior\": " + prior + " }"), beginning);
    };
    const std::string at = "9: /estimate/parameters/k2/prior";
    wrong("\"flatt\"", at + ": unknown value \"flatt\"; did you mean \"flat\"?");
    wrong("{}", at + ": needs \"normal\", \"lognormal\"");
    wrong("[1]", at + ": must be \"flat\" or { \"normal\"");
    wrong(R"({ "half_normal": { "scale": 1 }, "half_cauchy": { "scale": 1 } })",
          at + "/half_cauchy: stands beside \"half_normal\"");
    wrong(R"({ "half_norm": { "scale": 1 } })", at + "/half_norm: unknown key; did you mean \"half_normal\"?");
    wrong(R"({ "half_normal": { "sclae": 1, "scale": 1 } })", at + "/half_normal/sclae: unknown key; did you mean");
    wrong(R"({ "half_normal": {} })", at + "/half_normal: \"scale\" is missing");
    wrong(R"({ "half_normal": { "scale": 0 } })", at + "/half_normal/scale: must be > 0");
    wrong(R"({ "half_cauchy": { "scale": -1 } })", at + "/half_cauchy/scale: must be > 0");
    wrong(R"({ "gamma": { "shape": 0, "rate": 1 } })", at + "/gamma/shape: must be > 0");
    wrong(R"({ "gamma": { "shape": 2, "rate": "1" } })", at + "/gamma/rate: must be a number");
    wrong(R"({ "student_t": { "dof": 0, "location": 0, "scale": 1 } })", at + "/student_t/dof: must be > 0");
    wrong(R"({ "student_t": { "dof": 3, "scale": 1 } })", at + "/student_t: \"location\" is missing");
    wrong(R"({ "uniform": { "lower": 1, "upper": 1 } })", at + "/uniform: lower 1 must be below upper 1");
    // Readable, but the start has no density under it.
    wrong(R"({ "uniform": { "lower": 1, "upper": 2 } })", "9: /estimate/parameters/k2/start: start 0.001 of k2 has no");
}

TEST_CASE("every scale is read and written back", "[apps][job][scale]") {
    const auto read = [](const std::string& scale, const std::string& more) {
        const Job job = good(job_with("\"k2\": { \"start\": 1e-3, \"scale\": \"" + scale + "\"" + more + " }"));
        CHECK(job_document(job, job_folder)["estimate"]["parameters"]["k2"]["scale"] == scale);
        check_round_trip(job);
        return first(job);
    };
    CHECK(read("linear", "").scale == Scale::linear);
    CHECK(read("log", "").scale == Scale::log);
    CHECK(read("log10", "").scale == Scale::log10);
    CHECK(read("log10", ", \"bounds\": [0, 1]").lower == 0.0);
    const auto logit = read("logit", ", \"bounds\": [0, 0.5]");
    CHECK(logit.scale == Scale::logit);
    CHECK(logit.lower == 0.0);
    CHECK(logit.upper == 0.5);

    const std::string at = "9: /estimate/parameters/k2";
    const auto wrong = [](const std::string& entry, const std::string& beginning) {
        check_at(job_with("\n\"k2\": " + entry), beginning);
    };
    wrong(R"({ "start": 1e-3, "scale": "loggit", "bounds": [0, 1] })",
          at + "/scale: unknown value \"loggit\"; did you mean \"logit\"?");
    wrong(R"({ "start": 1e-3, "scale": "logit" })",
          at + "/scale: a logit scale needs finite \"bounds\"; they are [0, inf]");
    wrong(R"({ "start": 0, "scale": "logit", "bounds": [0, 1] })",
          at + "/start: start 0 of k2 must lie inside its bounds (0, 1) on a logit scale");
    wrong(R"({ "start": 0, "scale": "log10" })", at + "/start: start 0 of k2 has no logarithm");
    wrong(R"({ "start": 1, "scale": "log10", "bounds": [-1, 2] })", at + "/bounds/0: lower bound -1 lies outside");
}

TEST_CASE("ties are read, written back and checked", "[apps][job][tie]") {
    const Job job = good(job_with(R"("k1": { "tied": "k2" }, "k2": { "start": 1e-3 },
        "k3": { "tied": { "to": "k2", "factor": 2 } })"));
    const auto& parameters = job.estimate->parameters;
    REQUIRE(parameters.size() == 3);
    CHECK(parameters[0].value.tied_to == "k2");
    CHECK(parameters[0].value.tie_factor == 1.0);
    CHECK(parameters[0].value.start == 1e-3);
    CHECK(parameters[1].value.tied_to.empty());
    CHECK(parameters[2].value.tie_factor == 2.0);
    CHECK(parameters[2].value.start == 2e-3);
    CHECK(parameters[2].value.lower == 0.0);
    CHECK(job_document(job, job_folder)["estimate"]["parameters"]["k3"] ==
          nlohmann::ordered_json::parse(R"({ "tied": { "to": "k2", "factor": 2.0 } })"));
    check_round_trip(job);

    const std::string at = "9: /estimate/parameters/k3/tied";
    const auto wrong = [](const std::string& entry, const std::string& beginning) {
        check_at(job_with("\n\"k3\": " + entry + ", \"k2\": { \"start\": 1e-3 }, \"k1\": { \"tied\": \"k2\" }"),
                 beginning);
    };
    wrong(R"({ "tied": "k3" })", at + ": k3 is tied to itself");
    wrong(R"({ "tied": "k4" })", at + ": \"k4\" is no estimated parameter; did you mean");
    wrong(R"({ "tied": "k1" })", at + ": k1 is tied to k2 itself: tie both to that one");
    wrong(R"({ "tied": 3 })", at + ": must be the name of an estimated parameter or { \"to\"");
    wrong(R"({ "tied": { "to": "k2", "factor": 0 } })", at + "/factor: must be other than 0");
    wrong(R"({ "tied": { "to": "k2", "factor": -1 } })", at + ": start -0.001 of k3");
    wrong(R"({ "tied": { "to": "k2", "fctor": 1 } })", at + "/fctor: unknown key; did you mean \"factor\"?");
    wrong(R"({ "tied": { "factor": 1 } })", at + ": \"to\" is missing");
    wrong(R"({ "tied": "k2", "prior": "flat" })", "9: /estimate/parameters/k3/prior: does not go with \"tied\"");
    wrong(R"({ "tied": "k2", "start": 1 })", "9: /estimate/parameters/k3/start: does not go with \"tied\"");
}

TEST_CASE("a tie of parameters that are free per experiment holds in each of them", "[apps][job][tie]") {
    const std::string parameters = R"("k2": { "start": 1e-3 }, "k3": { "tied": "k2" })";
    const Job own = good(job_with(parameters, "", R"("free": ["k2", "k3"], )", R"("free": ["k3"], )"));
    const auto setup = identification::estimate_setup(apps::identification_problem(own, {}), {{"0"}, {"0"}});
    std::vector<std::pair<std::string, std::string>> ties;
    for (const auto& parameter : setup.parameters)
        if (!parameter.tied_to.empty()) ties.emplace_back(parameter.name, parameter.tied_to);
    CHECK(ties == std::vector<std::pair<std::string, std::string>>{{"k3@run1", "k2@run1"}, {"k3@run2", "k2"}});
    check_at(job_with("\n" + parameters, "", R"("free": ["k2"], )"),
             "9: /estimate/parameters/k3/tied: k2 is free in \"run1\": list k3 in \"free\" there too");
}

TEST_CASE("joint priors are read, written back and checked", "[apps][job][prior]") {
    const std::string parameters = R"("l": { "start": 0.3 }, "k2": { "start": 1e-3 }, "k3": { "start": 1e-3,
        "prior": { "normal": { "mean": 0, "sd": 1 } } }, "k1": { "tied": "k2" })";
    const auto with = [&](const std::string& priors) {
        return job_with(parameters, "\"joint_priors\": " + priors + ",");
    };
    const std::string prior =
        R"([ { "normal": { "names": ["l", "k2"], "mean": [0.3, 0.001], "covariance": [[0.01, 1e-5], [1e-5, 1e-6]] } } ])";
    const Job job = good(with(prior));
    REQUIRE(job.estimate->joint_priors.size() == 1);
    const auto& joint = job.estimate->joint_priors[0];
    CHECK(joint.names == std::vector<std::string>{"l", "k2"});
    CHECK(joint.mean == Eigen::Vector2d(0.3, 0.001));
    CHECK(joint.covariance(0, 1) == 1e-5);
    CHECK(joint.covariance(1, 1) == 1e-6);
    CHECK(job_document(job, job_folder)["estimate"]["joint_priors"] == nlohmann::ordered_json::parse(prior));
    check_round_trip(job);

    const std::string at = "6: /estimate/joint_priors";
    const auto wrong = [&](const std::string& names, const std::string& mean, const std::string& covariance,
                           const std::string& beginning) {
        check_at(with("[ { \"normal\": { \"names\": " + names + ", \"mean\": " + mean +
                      ", \"covariance\": " + covariance + " } } ]"),
                 beginning);
    };
    const std::string unit = "[[1, 0], [0, 1]]";
    wrong(R"(["l", "k4"])", "[1, 1]", unit, at + "/0/normal/names/1: \"k4\" is no estimated parameter; did you mean");
    wrong(R"(["l", "l"])", "[1, 1]", unit, at + "/0/normal/names/1: \"l\" stands in a joint prior already");
    wrong(R"(["l", "k3"])", "[1, 1]", unit, at + "/0/normal/names/1: k3 has a prior of its own");
    wrong(R"(["l", "k1"])", "[1, 1]", unit, at + "/0/normal/names/1: k1 is tied to k2: name that one");
    wrong(R"(["l", "k2"])", "[1]", unit, at + "/0/normal/mean: must hold one number per name: 2, not 1");
    wrong(R"(["l", "k2"])", "[1, 1]", "[[1, 0]]", at + "/0/normal/covariance: must be a matrix of 2 rows, not 1");
    wrong(R"(["l", "k2"])", "[1, 1]", "[[1, 2], [2, 1]]", at + "/0/normal: joint normal prior: covariance must be");
    wrong(R"(["l", "k2"])", "[1, 1]", "[[1, 0.5], [0, 1]]", at + "/0/normal: joint normal prior: covariance[1][0]");
    wrong("[]", "[]", "[]", at + "/0/normal: joint normal prior: names: needs at least one");
    check_at(with("{}"), at + ": must be a list");
    check_at(with("[ {} ]"), at + "/0: \"normal\" is missing");
    check_at(with("[ { \"normall\": 1, \"normal\": { \"names\": [\"l\"], \"mean\": [1], \"covariance\": [[1]] } } ]"),
             at + "/0/normall: unknown key; did you mean \"normal\"?");
    // The same parameter in two joint priors.
    const std::string one = R"({ "normal": { "names": ["l"], "mean": [1], "covariance": [[1]] } })";
    check_at(with("[" + one + ", " + one + "]"), at + "/1/normal/names/0: \"l\" stands in a joint prior already");
}

}  // namespace job_prior_test
