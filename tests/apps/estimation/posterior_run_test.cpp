// What a job asks for beyond the estimate, from data to result files: error distributions, full covariances, known sds,
// several starts, profiles, samples.

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <csignal>
#include <random>
#include <thread>

#include <fmt/format.h>

#include "tests/apps/program/program.hpp"
#include "tests/catch.hpp"

namespace posterior_run_test {

using namespace orbid::tests;

namespace {

/// Populations of 40 years with errors, as another program would have written them: sd 0.02 of ln for `lognormal`,
/// else 1 with correlation 0.6 between u and v; every tenth reading of u is off by 15 with `outliers`. The sds stand in
/// the column su (twice what they are).
std::string table(bool lognormal, bool outliers) {
    // Runge and Kutta's classical rule at 1/200 a: the error, 1e-9, is far below that of a reading.
    double u = 30.0;
    double v = 4.0;
    std::mt19937 generator(5);
    // Twelve uniform numbers: the sum has variance one, and the same value in every standard library.
    const auto normal = [&] {
        double sum = -6.0;
        for (int i = 0; i < 12; ++i)
            sum += static_cast<double>(generator()) / 4294967296.0;
        return sum;
    };
    const auto rate = [](double x, double y) { return std::pair{x * (0.55 - 0.028 * y), y * (0.024 * x - 0.8)}; };
    std::string text = "t,u,v,su\n";
    for (int k = 0; k <= 40; ++k) {
        const double common = normal();
        double eu = common;
        double ev = 0.6 * common + 0.8 * normal();
        if (outliers && k % 10 == 5) eu += 15.0;
        text += lognormal ? fmt::format("{},{},{},0.04\n", k, u * std::exp(0.02 * eu), v * std::exp(0.02 * ev))
                          : fmt::format("{},{},{},2\n", k, u + eu, v + ev);
        for (int step = 0; step < 200; ++step) {
            constexpr double h = 0.005;
            const auto [a1, b1] = rate(u, v);
            const auto [a2, b2] = rate(u + 0.5 * h * a1, v + 0.5 * h * b1);
            const auto [a3, b3] = rate(u + 0.5 * h * a2, v + 0.5 * h * b2);
            const auto [a4, b4] = rate(u + h * a3, v + h * b3);
            u += h * (a1 + 2.0 * a2 + 2.0 * a3 + a4) / 6.0;
            v += h * (b1 + 2.0 * b2 + 2.0 * b3 + b4) / 6.0;
        }
    }
    return text;
}

json population_job() {
    return json::parse(R"({
      "model": { "name": "lotka_volterra" },
      "data": { "name": "run1", "file": "data.csv", "kind": "samples",
                "columns": { "time": "t", "u": "u", "v": "v" } },
      "estimate": { "parameters": { "alpha": { "start": 0.5 }, "delta": { "start": 0.026 } },
                    "residuals": [ { "type": "series" } ] },
      "reference": { "alpha": 0.55, "delta": 0.024 },
      "output": { "series": "none" } })");
}

struct Run {
    Outcome outcome;
    json result;
};

Run run(const TemporaryFolder& folder, const json& job, const std::string& data) {
    write_text(folder.path() / "data.csv", data);
    const Path out = folder.path() / "out";
    Run done;
    done.outcome = orbid_with({"run", write_job(folder.path() / "job.json", job), "--out", out, "--force"});
    if (std::filesystem::exists(out / "result.json")) done.result = read_json(out / "result.json");
    return done;
}

void check_truth(const json& result) {
    for (const auto& [name, value] : {std::pair{"alpha", 0.55}, std::pair{"delta", 0.024}}) {
        const json& x = result["parameters"][name];
        CAPTURE(name, x.dump());
        CHECK(std::abs(x["value"].get<double>() - value) < 4.0 * x["sd"].get<double>());
    }
}

}  // namespace

TEST_CASE("heavy-tailed errors are estimated with their degrees of freedom", "[apps][run]") {
    const TemporaryFolder folder;
    json job = population_job();
    job["estimate"]["residuals"][0]["errors"]["u"] = {{"distribution", "student_t"}, {"dof", "estimate"}};
    const Run done = run(folder, job, table(false, true));
    CAPTURE(done.outcome.error, done.outcome.out);
    REQUIRE(done.outcome.code == 0);
    check_truth(done.result);
    const json& errors = done.result["errors"]["series.u"];
    CHECK(errors["distribution"] == "student_t");
    CHECK(errors["dof"]["value"].get<double>() >= 1.0);
    CHECK(errors["dof"]["value"].get<double>() < 4.0);  // a tenth of the readings is off by fifteen sds
    CHECK(errors["dof"]["uncertainty"].get<double>() > 0.0);
    // The scale is that of the good readings, 1, not of the outliers, 5; 41 readings know it to 20 %.
    CHECK_THAT(errors["sd"].get<double>(), WithinRel(1.0, 0.5));
    CHECK(done.result["errors"]["series.v"]["distribution"] == "normal");
    CHECK_THAT(done.outcome.out, ContainsSubstring("student_t, dof"));

    job["estimate"]["residuals"][0].erase("errors");
    const Run normal = run(folder, job, table(false, true));
    REQUIRE(normal.outcome.code == 0);
    CHECK_FALSE(normal.result["diagnostics"]["series.u"]["outliers"].empty());
    CHECK(normal.result["diagnostics"]["series.u"]["normality"]["shapiro_wilk"]["p"].get<double>() < 1e-3);
    CHECK(normal.result["diagnostics"]["series.v"]["outliers"].empty());
    CHECK_THAT(normal.outcome.out, ContainsSubstring("Residuals"));
}

TEST_CASE("two responses get one full covariance", "[apps][run]") {
    const TemporaryFolder folder;
    json job = population_job();
    job["estimate"]["residuals"][0]["covariance"] = {"u", "v"};
    const Run done = run(folder, job, table(false, false));
    CAPTURE(done.outcome.error, done.outcome.out);
    REQUIRE(done.outcome.code == 0);
    check_truth(done.result);
    const json& covariance = done.result["covariances"].at(0);
    CHECK(covariance["groups"] == json{"series.u", "series.v"});
    const double uu = covariance["matrix"][0][0];
    const double uv = covariance["matrix"][0][1];
    const double vv = covariance["matrix"][1][1];
    CHECK(covariance["matrix"][1][0] == uv);
    // 41 pairs: a variance is known to sqrt(2 / 41) = 22 %, the correlation 0.6 to (1 - 0.36) / sqrt(41) = 0.1; thrice.
    CHECK_THAT(uu, WithinRel(1.0, 0.66));
    CHECK_THAT(vv, WithinRel(1.0, 0.66));
    CHECK(std::abs(uv / std::sqrt(uu * vv) - 0.6) < 0.3);
    CHECK_THAT(done.outcome.out, ContainsSubstring("Covariances of errors"));
    CHECK_FALSE(done.result["log_evidence"]["reason"].get<std::string>().empty());
    CHECK(done.result["log_evidence"]["value"].is_null());
}

TEST_CASE("a column of sds is a shape with a factor", "[apps][run]") {
    const TemporaryFolder folder;
    json job = population_job();
    job["estimate"]["residuals"][0]["errors"]["u"]["sd"] = {{"column", "su"}, {"factor", "estimate"}};
    const Run done = run(folder, job, table(false, false));
    CAPTURE(done.outcome.error, done.outcome.out);
    REQUIRE(done.outcome.code == 0);
    check_truth(done.result);
    // The column says 2 where the errors have 1.
    CHECK_THAT(done.result["errors"]["series.u"]["factor"].get<double>(), WithinRel(0.5, 0.33));
    CHECK(done.result["errors"]["series.v"]["factor"].is_null());

    job["estimate"]["residuals"][0]["errors"]["u"]["sd"]["column"] = "nowhere";
    const Run missing = run(folder, job, table(false, false));
    CHECK(missing.outcome.code == 3);
    CHECK_THAT(missing.outcome.error, ContainsSubstring("nowhere"));
}

TEST_CASE("errors of a course in time may be autoregressive, relative or Laplace's", "[apps][run]") {
    const TemporaryFolder folder;
    for (const char* distribution : {"ar1", "relative", "laplace"}) {
        CAPTURE(distribution);
        json job = population_job();
        json error{{"distribution", distribution}};
        // Log-normal data of 2 % have no absolute part: it gets a floor to stay above.
        if (std::string(distribution) == "relative") error["floor"] = 1e-3;
        job["estimate"]["residuals"][0]["errors"] = {{"u", error}, {"v", error}};
        const bool sized = std::string(distribution) == "relative";
        const Run done = run(folder, job, table(sized, false));
        CAPTURE(done.outcome.error, done.outcome.out);
        REQUIRE(done.outcome.code == 0);
        check_truth(done.result);
        const json& errors = done.result["errors"]["series.u"];
        CHECK(errors["distribution"] == distribution);
        if (sized) CHECK_THAT(errors["relative"]["value"].get<double>(), WithinRel(0.02, 0.66));
        // Errors are white: 41 readings know the correlation to 1 / sqrt(41) = 0.16.
        if (errors.contains("correlation")) CHECK(std::abs(errors["correlation"]["value"].get<double>()) < 0.48);
    }
}

TEST_CASE("several starts, a profile and a sample stand in the result", "[apps][run]") {
    const TemporaryFolder folder;
    json job = population_job();
    job["data"]["initial_state"] = {{"u", {{"bounds", {5, 100}}}}, {"v", {{"bounds", {0.5, 20}}}}};
    job["estimate"]["parameters"]["alpha"]["bounds"] = {0.3, 0.9};
    job["estimate"]["parameters"]["delta"]["bounds"] = {0.01, 0.05};
    job["estimate"]["multi_start"] = {{"starts", 4}, {"seed", 2}};
    job["estimate"]["profile"] = {"alpha", "series.u.scale"};
    job["estimate"]["posterior"]["sample"] = {{"draws", 20}, {"chains", 2}, {"warm_up", 20}};
    const Run done = run(folder, job, table(false, false));
    CAPTURE(done.outcome.error, done.outcome.out);
    REQUIRE(done.outcome.code == 0);
    check_truth(done.result);
    CHECK(done.result["starts"].size() == 4);
    REQUIRE_FALSE(done.result["optima"].empty());
    CHECK_THAT(done.result["optima"][0]["parameters"]["alpha"].get<double>(),
               WithinRel(done.result["parameters"]["alpha"]["value"].get<double>(), 1e-3));
    CHECK(done.result["profile"].size() == 2);
    const json& profile = done.result["profile"]["alpha"];
    CHECK(profile["interval95"][0] < done.result["parameters"]["alpha"]["value"]);
    CHECK(profile["interval95"][1] > done.result["parameters"]["alpha"]["value"]);
    CHECK(profile["ends"] == json{"found", "found"});
    CHECK(done.result["marginals"].is_null());
    const json& sample = done.result["posterior"];
    CHECK(sample["status"] == "complete");
    CHECK(sample["trusted"] == false);  // twenty draws are too few, and it says so
    CHECK(sample["chains"].size() == 2);
    CHECK(sample["parameters"].contains("u_0@run1"));
    CHECK_THAT(done.outcome.out, ContainsSubstring("Do not trust yet") && ContainsSubstring("Optima") &&
                                     ContainsSubstring("Profile likelihood"));

    // The same bytes with one thread.
    const Path again = folder.path() / "again";
    REQUIRE(orbid_with({"run", folder.path() / "job.json", "--out", again, "--threads", "1"}).code == 0);
    for (const char* name : {"result.json", "posterior.csv"}) {
        CAPTURE(name);
        CHECK(
            (orbid::apps::read_whole_file(again / name) == orbid::apps::read_whole_file(folder.path() / "out" / name)));
    }
}

TEST_CASE("intervals by simulation stand beside those by curvature", "[apps][run][bootstrap]") {
    const TemporaryFolder folder;
    json job = population_job();
    job["estimate"]["intervals"] = {{"bootstrap", 200}, {"kind", "parametric"}};
    const Run done = run(folder, job, table(false, false));
    CAPTURE(done.outcome.error, done.outcome.out);
    REQUIRE(done.outcome.code == 0);
    const json& found = done.result["intervals"];
    CHECK(found["kind"] == "parametric");
    CHECK(found["replicates"] == 200);
    CHECK(found["failed"] == 0);
    CHECK(found["refused"].is_null());
    for (const auto& [name, truth] : {std::pair{"alpha", 0.55}, std::pair{"delta", 0.024}}) {
        const json& x = found["parameters"][name];
        CAPTURE(name, x.dump());
        CHECK(x["value"] == done.result["parameters"][name]["value"]);
        CHECK(x["sd"] == done.result["parameters"][name]["sd"]);
        // The problem is nearly linear; 200 replicates know a sd to 5 %.
        CHECK_THAT(x["bootstrap_sd"].get<double>(), WithinRel(x["sd"].get<double>(), 0.25));
        CHECK(std::abs(x["bias_in_sds"].get<double>()) < 0.35);
        for (const char* ends : {"percentile95", "studentised95"}) {
            CHECK(x[ends][0].get<double>() < x["value"].get<double>());
            CHECK(x[ends][1].get<double>() > x["value"].get<double>());
            CHECK(std::abs(x[ends][1].get<double>() - truth) < 8.0 * x["sd"].get<double>());
        }
    }
    CHECK(found["errors"].contains("series.u.scale"));
    CHECK_THAT(done.outcome.out,
               ContainsSubstring("Intervals by simulation") &&
                   ContainsSubstring("200 records drawn anew: errors of the estimated laws; 0 failed"));
    const std::string report = orbid::apps::read_whole_file(folder.path() / "out" / "report.html");
    CHECK_THAT(report, ContainsSubstring("By simulation") && ContainsSubstring("studentised 95 %"));
    const std::string replicates = orbid::apps::read_whole_file(folder.path() / "out" / "bootstrap.csv");
    CHECK(std::count(replicates.begin(), replicates.end(), '\n') == 201);
    CHECK(replicates.starts_with("replicate,status,alpha,sd(alpha),delta,sd(delta),series.u.scale,"));

    const Path again = folder.path() / "again";
    REQUIRE(orbid_with({"run", folder.path() / "job.json", "--out", again, "--threads", "1"}).code == 0);
    for (const char* name : {"result.json", "bootstrap.csv"}) {
        CAPTURE(name);
        CHECK(
            (orbid::apps::read_whole_file(again / name) == orbid::apps::read_whole_file(folder.path() / "out" / name)));
    }
}

TEST_CASE("a posterior that does not exist is refused by name, the estimate stays", "[apps][run]") {
    const TemporaryFolder folder;
    json job = population_job();
    job["estimate"]["parameters"] = {{"alpha", {{"start", 0.5}}}, {"delta", {{"start", 0.026}}}};
    job["data"]["initial_state"] = {{"u", {{"value", 30}}}, {"v", {{"value", 0}}}};
    job["data"]["observe"] = {"u"};
    job["estimate"]["posterior"]["sample"] = 10;
    const Run done = run(folder, job, "t,u,v,su\n0,30,0,1\n1,52,0,1\n2,90,0,1\n3,156,0,1\n");
    CAPTURE(done.outcome.error, done.outcome.out);
    // Other records of u would tell: without lynx nothing says what a lynx makes of a hare.
    CHECK(done.outcome.code == 1);
    CHECK(done.result["posterior"]["status"] == "refused");
    CHECK_THAT(done.result["posterior"]["message"].get<std::string>(), ContainsSubstring("delta"));
    CHECK_THAT(done.outcome.error, ContainsSubstring("posterior: "));
}

TEST_CASE("an interrupted sample leaves the estimate and its draws", "[apps][run]") {
    const TemporaryFolder folder;
    json job = population_job();
    // Far more than anybody waits for.
    job["estimate"]["posterior"]["sample"] = {{"draws", 1000000}, {"chains", 2}, {"warm_up", 10}};
    const Path out = folder.path() / "out";
    std::signal(SIGINT, SIG_IGN);
    std::thread stop([&] {
        // The estimate is stored before the sampling begins.
        while (!std::filesystem::exists(out / "result.json"))
            std::this_thread::sleep_for(std::chrono::milliseconds(5));
        std::this_thread::sleep_for(std::chrono::milliseconds(500));
        std::raise(SIGINT);
    });
    const Run done = run(folder, job, table(false, false));
    stop.join();
    std::signal(SIGINT, SIG_DFL);
    CAPTURE(done.outcome.error);
    CHECK(done.outcome.code == 130);
    CHECK(done.result["status"] == "interrupted");
    check_truth(done.result);
    CHECK(done.result["posterior"]["status"] == "interrupted");
    CHECK(std::filesystem::exists(out / "posterior.csv"));
}

}  // namespace posterior_run_test
