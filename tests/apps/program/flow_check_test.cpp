// "flow" of a job, and what `orbid check --flow` says about both steppers.

#include <string>

#include "apps/job/reading/job_reader.hpp"
#include "apps/program/check/flow_check.hpp"
#include "tests/apps/program/program.hpp"
#include "tests/catch.hpp"

namespace flow_check_test {

using namespace orbid;
using namespace orbid::tests;

namespace {

json orbit_job() {
    return json::parse(R"({ "model": { "name": "driven_pendulum" },
      "periodic": { "orbits": [ { "period": 1, "points": [[0.3, 0.5]] } ] } })");
}

apps::Job read(const json& job) {
    const auto reading = apps::read_job(job.dump(), "job.json");
    REQUIRE(reading.problems.empty());
    return *reading.job;
}

}  // namespace

TEST_CASE("flows of a job agree by both steppers", "[apps][command][odeint]") {
    const TemporaryFolder folder;
    const Path file = write_job(folder.path() / "job.json", orbit_job());
    const Outcome check = orbid_with({"check", file, "--flow"});
    CAPTURE(check.out, check.error);
    CHECK(check.code == 0);
    CHECK(check.error.empty());
    for (const char* part : {"1 start over 3 periods of the forcing, tolerance 1e-12", "value", "by the start's theta",
                             "by omega", "steps: verner "})
        CHECK_THAT(check.out, ContainsSubstring(part));
    CHECK_THAT(orbid_with({"check", file}).out, !ContainsSubstring("steps: verner"));

    for (const char* stepper : {"verner", "odeint"}) {
        json job = orbit_job();
        job["flow"]["stepper"] = stepper;
        const apps::FlowCheck flows = apps::check_flows(read(job));
        CHECK(flows.starts == 1);
        CHECK(flows.failed == 0);
        CHECK(flows.differences.rows() == 2);
        CHECK(flows.differences.cols() == static_cast<Eigen::Index>(1 + flows.directions.size()));
        // Tolerance 1e-12 (values) and 1e-11 (derivatives) a step, some thousand steps of Odeint.
        CHECK(flows.differences.maxCoeff() < 1e-8);
        CHECK(flows.differences.maxCoeff() > 0.0);
        CHECK(flows.odeint_steps > 5 * flows.own_steps);
    }
}

TEST_CASE("parameters of the comparison are the estimated ones, starts those of the data", "[apps][command][odeint]") {
    const json job = json::parse(R"({ "model": { "name": "lorenz" },
      "data": { "simulate": { "samples": { "step": 0.01, "count": 11 }, "initial": [[1, 2, 20], [-3, 4, 25]] } },
      "estimate": { "parameters": { "rho": { "start": 27 } }, "residuals": [ { "type": "series" } ] } })");
    const apps::FlowCheck flows = apps::check_flows(read(job));
    CHECK(flows.starts == 2);
    CHECK(flows.over == "30 sampling intervals");
    CHECK(flows.directions == std::vector<std::string>{"x", "y", "z", "rho"});
    CHECK(flows.differences.maxCoeff() < 1e-9);
}

TEST_CASE("what Odeint cannot integrate is not compared", "[apps][command][odeint]") {
    const TemporaryFolder folder;
    json job = json::parse(R"({ "model": { "name": "parametric_pendulum", "parameters": { "k1": 1e-3 } },
      "data": { "simulate": { "sections": 1024 } } })");
    const Outcome rough = orbid_with({"check", write_job(folder.path() / "job.json", job), "--flow"});
    CHECK(rough.code == 2);
    CHECK_THAT(rough.error,
               ContainsSubstring("nothing to compare: the equations jump at the parameters of the model") &&
                   ContainsSubstring("k1 = 0"));
    job["flow"]["stepper"] = "odeint";
    const Outcome refused = orbid_with({"check", write_job(folder.path() / "job.json", job)});
    CHECK(refused.code == 2);
    CHECK_THAT(refused.error, ContainsSubstring("/flow/stepper: must be \"verner\" here: the equations jump"));
}

TEST_CASE("job.json names a stepper that is not the default", "[apps][job][odeint]") {
    const TemporaryFolder folder;
    json job = json::parse(R"({ "model": { "name": "parametric_pendulum" },
      "flow": { "stepper": "odeint" },
      "periodic": { "orbits": [ { "period": 1, "points": [[2.96, 6.40]] } ] } })");
    CHECK_THAT(orbid_with({"check", write_job(folder.path() / "job.json", job)}).error,
               ContainsSubstring("/flow/stepper: must be \"verner\" here: derivatives by k1 jump"));
    job["periodic"]["free"] = {"l", "omega"};
    std::string orbits[2];
    for (const char* stepper : {"verner", "odeint"}) {
        CAPTURE(stepper);
        job["flow"]["stepper"] = stepper;
        const Path out = folder.path() / stepper;
        const Outcome run =
            orbid_with({"periodic", write_job(folder.path() / "job.json", job), "--out", out, "--quiet"});
        CAPTURE(run.error);
        REQUIRE(run.code == 0);
        const json written = read_json(out / "job.json");
        const bool own = std::string(stepper) == "verner";
        CHECK(written.contains("flow") != own);
        if (!own) CHECK(written["flow"]["stepper"] == "odeint");
        const json orbit = read_json(out / "orbits.json")["cycles"][0];
        CHECK(orbit["status"] == "converged");
        orbits[own ? 0 : 1] = orbit["points"].dump();
        if (own) {
            // The job without the key is the same job.
            job.erase("flow");
            const Outcome again =
                orbid_with({"periodic", write_job(folder.path() / "job.json", job), "--out", out, "--quiet"});
            CHECK(again.code == 0);
        }
    }
    const json own = json::parse(orbits[0]), other = json::parse(orbits[1]);
    // Both solve to the tolerance of the flow, times what the orbit makes of it.
    for (std::size_t i = 0; i < 2; ++i)
        CHECK_THAT(other[0][i].get<double>(), WithinAbs(own[0][i].get<double>(), 1e-9));
}

}  // namespace flow_check_test
