// Error distributions, posterior sampling, profiles and several starts in a job: what is read, written and refused.

#include <filesystem>
#include <string>
#include <vector>

#include "apps/job/data_job.hpp"
#include "apps/job/estimate_job.hpp"
#include "apps/job/reading/job_reader.hpp"
#include "apps/job/writing/job_writer.hpp"
#include "tests/apps/job/job_problems.hpp"
#include "tests/apps/program/program.hpp"
#include "tests/catch.hpp"

namespace job_errors_test {

using namespace orbid;
using namespace orbid::apps;
using tests::check_only;
using tests::ContainsSubstring;
using tests::job_folder;
using tests::problems;

namespace {

/// Two series of the pendulum; `errors` and `estimate` are members put into the residual and the estimate.
std::string series_job(const std::string& errors, const std::string& estimate = "") {
    return R"({ "model": { "name": "lotka_volterra" }, "seed": 7,
  "data": { "name": "run1", "simulate": { "samples": { "step": 0.5, "count": 41 }, "initial": [[30, 4]] },
    "initial_state": { "u": { "start": 30, "prior": { "lognormal": { "median": 10, "log_sd": 1 } } } } },
  "estimate": { "parameters": { "alpha": { "start": 0.5 } },
    "residuals": [ { "type": "series",
)" + errors +
           R"(
    } ])" + (estimate.empty() ? "" : ",\n" + estimate) +
           " } }";
}

/// A cycles job, weights as given.
std::string cycles_job(const std::string& rest) {
    return R"({ "model": { "name": "parametric_pendulum" },
  "data": { "simulate": { "sections": 1024 } }, "orbits": { "periods": [1] },
  "estimate": { "parameters": { "l": { "start": 0.3 } }, "residuals": [ { "type": "cycles",
)" + rest + " } ] } }";
}

Job read(const std::string& text) {
    const auto found = problems(text);
    CAPTURE(text, found);
    REQUIRE(found.empty());
    return *read_job(text, job_folder / "job.json").job;
}

const std::string at_u = "job.json:6: /estimate/residuals/0/errors/u";

}  // namespace

TEST_CASE("every distribution of errors is read with its parameters", "[apps][job]") {
    const auto error = [](const std::string& u) {
        return read(series_job("\"errors\": { \"u\": " + u + " }")).estimate->series->errors.at(0);
    };
    CHECK(std::holds_alternative<estimator::NormalErrors>(error("{ \"sd\": 0.1 }").distribution));
    CHECK(std::holds_alternative<estimator::LaplaceErrors>(error("{ \"distribution\": \"laplace\" }").distribution));

    const auto student = std::get<estimator::StudentErrors>(error("{ \"distribution\": \"student_t\" }").distribution);
    CHECK_FALSE(student.dof.estimate);
    CHECK(student.dof.value == 4.0);
    const auto estimated = std::get<estimator::StudentErrors>(
        error(
            R"({ "distribution": "student_t", "dof": { "estimate": { "start": 3, "prior": { "lognormal": { "median": 10, "log_sd": 1 } } } } })")
            .distribution);
    CHECK(estimated.dof.estimate);
    CHECK(estimated.dof.value == 3.0);
    CHECK(std::get<estimator::LogNormalPrior>(estimated.dof.prior).median == 10.0);

    const ErrorJob lognormal = error(
        R"({ "distribution": "lognormal", "sd": { "estimate": { "prior": { "lognormal": { "median": 0.37, "log_sd": 1 } } } } })");
    CHECK(std::holds_alternative<estimator::LogNormalErrors>(lognormal.distribution));
    CHECK(lognormal.scale.value == 0.0);  // from the residuals
    CHECK(std::get<estimator::LogNormalPrior>(lognormal.scale.prior).median == 0.37);

    const auto relative = std::get<estimator::RelativeErrors>(
        error(R"({ "distribution": "relative", "relative": 0.03, "sd": "estimate", "floor": 0.001 })").distribution);
    CHECK_FALSE(relative.relative.estimate);
    CHECK(relative.relative.value == 0.03);
    CHECK(error(R"({ "sd": "estimate", "floor": 0.001 })").floor == 0.001);

    const auto chain = std::get<estimator::AutoregressiveErrors>(
        error(R"({ "distribution": "ar1", "correlation": "estimate" })").distribution);
    CHECK(chain.correlation.estimate);
    CHECK(chain.correlation.value == 0.0);
}

TEST_CASE("a column of sds and a full covariance are read", "[apps][job]") {
    const tests::TemporaryFolder data;
    tests::write_text(data.path() / "d.csv", "t,u,v,su\n0,1,2,0.1\n1,1,2,0.1\n");
    const auto job = [&](const std::string& errors) {
        return read(R"({ "model": { "name": "lotka_volterra" },
          "data": { "file": ")" +
                    (data.path() / "d.csv").string() +
                    R"(", "kind": "samples", "columns": { "time": "t", "u": "u", "v": "v" } },
          "estimate": { "parameters": {}, "residuals": [ { "type": "series", )" +
                    errors + " } ] } }");
    };
    const auto known = job(R"("errors": { "u": { "sd": { "column": "su", "factor": "estimate" } } })");
    CHECK(known.estimate->series->errors[0].sd_column == "su");
    CHECK(known.estimate->series->errors[0].scale.estimate);
    const auto exact = job(R"("errors": { "u": { "sd": { "column": "su" } } })");
    CHECK_FALSE(exact.estimate->series->errors[0].scale.estimate);
    CHECK(exact.estimate->series->errors[0].scale.value == 1.0);

    const auto plain = job(R"("errors": { "covariance": ["u", "v"] })");
    REQUIRE(plain.estimate->series->covariances.size() == 1);
    CHECK(plain.estimate->series->covariances[0].coordinates == std::vector<Eigen::Index>{0, 1});
    CHECK(plain.estimate->series->covariances[0].dof == 0.0);
    const auto wishart = job(
        R"("covariance": { "of": ["v", "u"], "prior": { "inverse_wishart": { "dof": 3, "matrix": [[2, 0.5], [0.5, 1]] } } })");
    const CovarianceJob& covariance = wishart.estimate->series->covariances.at(0);
    CHECK(covariance.coordinates == std::vector<Eigen::Index>{1, 0});
    CHECK(covariance.dof == 3.0);
    CHECK(covariance.psi(0, 0) == 2.0);
    CHECK(covariance.psi(0, 1) == 0.5);
    // The complete form reads back.
    const std::string text = job_text(wishart, data.path());
    CHECK(job_text(*read_job(text, data.path() / "job.json").job, data.path()) == text);
}

TEST_CASE("errors that cannot be meant are refused with place and rule", "[apps][job]") {
    const auto refused = [](const std::string& u, const std::string& where, const std::string& rule) {
        check_only(series_job("\"errors\": { \"u\": " + u + " }"), at_u + where + ": " + rule);
    };
    refused(R"({ "distribution": "student", "sd": 1 })", "/distribution", "unknown value \"student\"");
    refused(R"({ "distribution": "student_t", "dof": 0.5 })", "/dof", "must be >= 1, not 0.5");
    refused(R"({ "distribution": "student_t", "dof": "guess" })", "/dof", "must be a number");
    refused(R"({ "distribution": "student_t", "dof": { "estimate": { "start": 0 } } })", "/dof/estimate/start",
            "must be >= 1, not 0");
    refused(R"({ "distribution": "student_t", "dof": {} })", "/dof", "\"estimate\" is missing");
    refused(R"({ "distribution": "laplace", "dof": 4 })", "/dof", "belongs to");
    refused(R"({ "distribution": "relative", "relative": 0 })", "/relative", "must be > 0, not 0");
    refused(R"({ "distribution": "ar1", "correlation": 1 })", "/correlation", "must be > -1 and < 1, not 1");
    refused(R"({ "sd": 0 })", "/sd", "must be > 0, not 0");
    refused(R"({ "sd": true })", "/sd", "must be a number, \"estimate\" or");
    refused(R"({ "sd": 1, "floor": 0.1 })", "/floor", "belongs to a sd that is estimated");
    refused(R"({ "sd": "estimate", "floor": -1 })", "/floor", "must be >= 0, not -1");
    refused(R"({ "sd": { "estimate": { "start": 0.1 } }, "floor": 1 })", "/floor", "1 lies above the start 0.1");
    refused(R"({ "sd": { "column": "" } })", "/sd/column", "must be the header of a column");
    refused(R"({ "sd": { "column": "su" } })", "", "\"run1\" is no table in text: it has no column \"su\"");
    refused(R"({ "distribution": "lognormal", "sd": { "column": "su" } })", "", "a column of sds goes with");
    refused(R"({ "sd": { "column": "su", "factor": 0 } })", "/sd/factor", "must be > 0, not 0");
    check_only(series_job(R"("errors": { "w": { "sd": 1 } })"), "has no coordinate \"w\"");

    const std::string angle = R"({ "model": { "name": "free_pendulum" },
      "data": { "simulate": { "samples": { "step": 0.1, "count": 41 }, "initial": [[1, 0]] } },
      "estimate": { "parameters": {}, "residuals": [ { "type": "series",
        "errors": { "phi": { "distribution": "lognormal" } } } ] } })";
    check_only(angle, "job.json:4: /estimate/residuals/0/errors/phi: phi is an angle: it has no size");
}

TEST_CASE("full covariances that cannot be meant are refused with place and rule", "[apps][job]") {
    const std::string inside = "job.json:6: /estimate/residuals/0/errors/covariance";
    const std::string beside = "job.json:6: /estimate/residuals/0/covariance";
    check_only(series_job(R"("errors": { "covariance": ["u"] })"), inside + ": must hold 2 values");
    check_only(series_job(R"("covariance": { "of": ["u", "v"], "prior": {} })"),
               beside + "/prior: \"inverse_wishart\" is missing");
    check_only(
        series_job(
            R"("covariance": { "of": ["u", "v"], "prior": { "inverse_wishart": { "dof": 1, "matrix": [[1, 0], [0, 1]] } } })"),
        beside + "/prior/inverse_wishart/dof: must be > 1, not 1");
    for (const char* matrix : {"[[1, 2], [2, 1]]", "[[1, 0.5], [0, 1]]"}) {
        check_only(
            series_job(
                std::string(
                    R"("covariance": { "of": ["u", "v"], "prior": { "inverse_wishart": { "dof": 3, "matrix": )") +
                matrix + " } } }"),
            "/matrix: must be symmetric and positive definite");
    }
    check_only(
        series_job(
            R"("covariance": { "of": ["u", "v"], "prior": { "inverse_wishart": { "dof": 3, "matrix": [[1, 0]] } } })"),
        "/matrix: must be a matrix of 2 rows, not 1");
    check_only(series_job(R"("errors": { "covariance": ["u", "v"] }, "covariance": ["u", "v"])"),
               beside + ": stands in \"errors\" already");
    check_only(series_job(R"("errors": { "u": { "distribution": "laplace" }, "covariance": ["u", "v"] })"),
               at_u + ": u has a full covariance with others");
    check_only(series_job(R"("errors": { "u": { "sd": 0.1 } }, "covariance": ["u", "v"])"),
               at_u + ": u has a full covariance with others");
}

TEST_CASE("cycles allow the errors that their points can have", "[apps][job]") {
    const std::string phi = "job.json:4: /estimate/residuals/0/errors/phi";
    check_only(cycles_job(R"("errors": { "phi": { "distribution": "student_t" } })"),
               phi + ": with \"weights\": \"covariance\" errors must be normal");
    check_only(cycles_job(R"("weights": "equal", "errors": { "phi": { "distribution": "ar1" } })"),
               phi + ": the points of a cycle are no course in time");
    check_only(cycles_job(R"("weights": "equal", "errors": { "phi": { "distribution": "relative" } })"),
               phi + ": phi is an angle");
    check_only(cycles_job(R"("weights": "equal", "errors": { "phi_dot": { "distribution": "relative" } })"),
               phi + "_dot: positions of cycles have no such errors");
    check_only(cycles_job(R"("errors": { "phi": { "sd": { "column": "s" } } })"),
               phi + ": cycles have no column of sds");
    check_only(cycles_job(R"("covariance": ["phi", "phi_dot"])"),
               "/estimate/residuals/0/covariance: with \"weights\": \"covariance\" the analysis' covariance");
    const Job job = read(cycles_job(R"("weights": "equal", "covariance": ["phi", "phi_dot"])"));
    CHECK(job.estimate->cycles->covariances.size() == 1);
    const Job heavy = read(
        cycles_job(R"("weights": "equal", "errors": { "phi": { "distribution": "student_t", "dof": "estimate" } })"));
    CHECK(std::holds_alternative<estimator::StudentErrors>(heavy.estimate->cycles->errors[0].distribution));
}

TEST_CASE("several starts, samples, profiles and marginals are read and written", "[apps][job]") {
    const Job none = read(series_job("\"errors\": {}"));
    CHECK(none.estimate->multi_start.starts == 1);
    CHECK(none.estimate->multi_start.seed == 7);
    CHECK(none.estimate->sample.draws == 0);
    CHECK_FALSE(none.estimate->profile.any());
    CHECK_FALSE(none.estimate->marginals.any());

    const Job job =
        read(series_job("\"errors\": {}", R"("variance": "integrated", "multi_start": { "starts": 8, "seed": 3 },
      "posterior": { "sample": { "draws": 100, "chains": 2, "warm_up": 50 } }, "profile": true,
      "marginals": ["u_0@run1", "series.u.scale"])"));
    CHECK(job.estimate->variance == estimator::Variance::integrated);
    CHECK(job.estimate->multi_start.starts == 8);
    CHECK(job.estimate->multi_start.seed == 3);
    CHECK(job.estimate->sample.draws == 100);
    CHECK(none.estimate->intervals.bootstrap == 0);
    const Job simulated = read(series_job("\"errors\": {}", R"("intervals": { "bootstrap": 40, "kind": "blocks" })"));
    CHECK(simulated.estimate->intervals.bootstrap == 40);
    CHECK(simulated.estimate->intervals.kind == estimator::ErrorDraw::blocks);
    const auto with_intervals = [](const char* intervals) { return series_job("\"errors\": {}", intervals); };
    check_only(with_intervals(R"("intervals": { "bootstrap": 39 })"),
               "/estimate/intervals/bootstrap: must be 0 or at least 40, not 39: the ends of a 95 % interval");
    check_only(with_intervals(R"("intervals": { "bootstrap": -5 })"),
               "/estimate/intervals/bootstrap: must be a whole number from 0 to 100000");
    check_only(with_intervals(R"("intervals": { "bootstrap": 1000000 })"),
               "/estimate/intervals/bootstrap: must be a whole number from 0 to 100000");
    check_only(with_intervals(R"("intervals": { "bootstrap": 100, "kind": "block" })"),
               "/estimate/intervals/kind: unknown value \"block\"; did you mean \"blocks\"?");
    CHECK(job.estimate->sample.chains == 2);
    CHECK(job.estimate->sample.warm_up == 50);
    CHECK(job.estimate->profile.contains("alpha"));
    CHECK(job.estimate->marginals.contains("u_0@run1"));
    CHECK(job.estimate->marginals.contains("u_0@run1.5"));  // one of its segments
    CHECK_FALSE(job.estimate->marginals.contains("u_0@run12"));
    CHECK_FALSE(job.estimate->marginals.contains("alpha"));
    const std::string text = job_text(job, job_folder);
    CHECK(job_text(*read_job(text, job_folder / "job.json").job, job_folder) == text);

    const auto refused = [](const std::string& member, const std::string& message) {
        check_only(series_job("\"errors\": {}", member), message);
    };
    refused("\"multi_start\": { \"starts\": 0 }",
            "job.json:8: /estimate/multi_start/starts: must be a whole number from 1");
    refused("\"multi_start\": { \"count\": 2 }", "/estimate/multi_start/count: unknown key");
    refused("\"posterior\": { \"sample\": -1 }", "/estimate/posterior/sample: must be a whole number from 0");
    refused("\"posterior\": { \"sample\": \"many\" }",
            "/estimate/posterior/sample: must be a whole number or { \"draws\"");
    refused("\"posterior\": { \"sample\": { \"chains\": 4 } }", "/estimate/posterior/sample: \"draws\" is missing");
    refused("\"posterior\": { \"sample\": { \"draws\": 10, \"chains\": 1 } }",
            "/estimate/posterior/sample/chains: must be a whole number from 2");
    refused("\"profile\": 1", "/estimate/profile: must be true, false or a list");
    refused("\"profile\": [\"beta\"]", "/estimate/profile/0: \"beta\" is not estimated; known: \"alpha\"");
    refused("\"marginals\": [\"alpha\", \"alpha\"]", "/estimate/marginals/1: \"alpha\" is listed twice");
}

TEST_CASE("an initial value with more than a normal prior becomes a parameter", "[apps][job]") {
    const auto initial = [](const std::string& u) {
        std::string text = series_job("\"errors\": {}");
        const std::string given = R"({ "start": 30, "prior": { "lognormal": { "median": 10, "log_sd": 1 } } })";
        return text.replace(text.find(given), given.size(), u);
    };
    const auto value = [&](const std::string& u) { return read(initial(u)).data[0].initial_state[0]; };
    CHECK_FALSE(value("\"estimate\"").is_parameter());
    CHECK_FALSE(value(R"({ "prior": { "normal": { "mean": 30, "sd": 1 } } })").is_parameter());
    CHECK_FALSE(value(R"({ "value": 30 })").is_parameter());
    const InitialValueJob lognormal = value(R"({ "prior": { "lognormal": { "median": 10, "log_sd": 1 } } })");
    CHECK(lognormal.is_parameter());
    CHECK(lognormal.scale == estimator::Scale::log);
    CHECK(lognormal.lower == 0.0);
    CHECK(value(R"({ "bounds": [0, null] })").is_parameter());
    CHECK(value(R"({ "start": 3, "scale": "log" })").is_parameter());

    const auto refused = [&](const std::string& u, const std::string& message) {
        const auto found = problems(initial(u));
        CAPTURE(found);
        REQUIRE(found.size() == 1);
        CHECK_THAT(found[0], ContainsSubstring("/data/initial_state/u") && ContainsSubstring(message));
    };
    refused(R"({ "start": -1, "scale": "log" })", "/start: start -1 has no logarithm");
    refused(R"({ "start": 3, "bounds": [4, 5] })", "/start: start 3 lies outside the bounds [4, 5]");
    refused(R"({ "bounds": [5, 4] })", "/bounds: lower bound 5 must be below the upper bound 4");
    refused(R"({ "bounds": [5] })", "/bounds: must be [lower, upper]");
    refused(R"({ "scale": "log", "bounds": [-1, 4] })", "/bounds: lower bound -1 must be >= 0 on a log scale");
    refused(R"({ "start": 3, "prior": { "uniform": { "lower": 4, "upper": 5 } } })", "/start: start 3 has no density");
}

}  // namespace job_errors_test
