// Sets of parameters of which the data can only determine combinations (the paper: "cannot be estimated
// simultaneously"). Friction enters as k1/m, k2/m, k3/m; the equation of motion of the crank pendulum is unchanged when
// l, g and A are scaled together, with k2, k3 as the square of the scale (k2 / (m l^2) and k3 / (m l^2) stay).

#include <cmath>

#include "tests/apps/program/program.hpp"
#include "tests/catch.hpp"

namespace singular_sets_test {

using namespace orbid::tests;

namespace {

struct SingularSet {
    std::string parameters;
    std::map<std::string, double> null_direction;  ///< relative changes, largest 1
    std::string decided;                           ///< gets a prior
    std::string prior;
};

json job_of(const SingularSet& set) {
    json job = pendulum_job(32768);
    job["orbits"]["periods"] = {1, 2, 3, 4, 5};
    job["estimate"].erase("derived");
    job.erase("reference");
    job["estimate"]["parameters"] = json::parse(set.parameters);
    return job;
}

void check_direction(const json& result, const SingularSet& set, double tolerance) {
    const json& directions = result["identifiability"]["null_directions"];
    REQUIRE(directions.size() == 1);
    CAPTURE(directions.dump());
    CHECK(directions[0].size() == set.null_direction.size());
    for (const auto& [name, component] : set.null_direction) {
        CAPTURE(name);
        REQUIRE(directions[0].contains(name));
        CHECK_THAT(directions[0][name].get<double>(), WithinAbs(component, tolerance));
    }
}

}  // namespace

TEST_CASE("sets that cannot be told apart are called singular, and run with a prior", "[apps][singular]") {
    const std::string m_prior = R"({ "normal": { "mean": 0.09, "sd": 0.01 } })";
    const std::vector<SingularSet> sets{
        {R"({ "l": { "start": 0.35 }, "m": { "start": 0.1 }, "k2": { "start": 6e-4 }, "k3": { "start": 2.2e-4 } })",
         {{"m", 1.0}, {"k2", 1.0}, {"k3", 1.0}},
         "m",
         m_prior},
        // k1 is 0 in truth and ends at its bound: held there, it takes no part.
        {R"({ "k1": { "start": 1e-5 }, "k2": { "start": 6e-4 }, "k3": { "start": 2.2e-4 }, "m": { "start": 0.1 } })",
         {{"m", 1.0}, {"k2", 1.0}, {"k3", 1.0}},
         "m",
         m_prior},
        {R"({ "l": { "start": 0.35 }, "g": { "start": 10.5 }, "A": { "start": 0.14 }, "k2": { "start": 6e-4 },
              "k3": { "start": 2.2e-4 } })",
         {{"l", 0.5}, {"g", 0.5}, {"A", 0.5}, {"k2", 1.0}, {"k3", 1.0}},
         "g",
         R"({ "normal": { "mean": 9.8, "sd": 0.1 } })"},
    };
    for (const SingularSet& set : sets) {
        CAPTURE(set.parameters);
        const TemporaryFolder folder;
        json job = job_of(set);
        const Path free = folder.path() / "free";
        const Outcome alone = orbid_with({"run", write_job(folder.path() / "free.json", job), "--out", free});
        CHECK(alone.code == 1);
        json result = read_json(free / "result.json");
        CHECK(result["status"] == "singular");
        // The direction stands relative to each value; on a linear scale relative to the value where the estimate
        // stopped. Measured 1e-3 at worst (a curved direction where the prior pulls the estimate away), times ten.
        check_direction(result, set, 1e-2);
        CHECK_THAT(alone.out, ContainsSubstring("Not determined by the data"));
        CHECK_THAT(alone.out, !ContainsSubstring("prior alone"));
        for (const auto& component : set.null_direction) {
            CAPTURE(component.first);
            CHECK(result["parameters"][component.first]["sd"].is_null());
            CHECK(result["parameters"][component.first]["interval95"].is_null());
        }

        job["estimate"]["parameters"][set.decided]["prior"] = json::parse(set.prior);
        const Path held = folder.path() / "held";
        const Outcome with_prior = orbid_with({"run", write_job(folder.path() / "held.json", job), "--out", held});
        CHECK(with_prior.code == 0);
        result = read_json(held / "result.json");
        CHECK(result["status"] == "converged");
        CHECK_THAT(result["message"].get<std::string>(), ContainsSubstring("the prior alone decides"));
        check_direction(result, set, 1e-2);
        CHECK_THAT(with_prior.out, ContainsSubstring(set.decided + " is decided by the prior alone"));
        // What the data say nothing about keeps the sd of the prior; the curvature of the exact direction changes it by
        // its square, (sd / mean)^2 = 1.2 % at most; twice that.
        const double sd = job["estimate"]["parameters"][set.decided]["prior"]["normal"]["sd"];
        CHECK_THAT(result["parameters"][set.decided]["sd"].get<double>(), WithinRel(sd, 0.025));
    }
}

TEST_CASE("a combination that the data determine is met although its parts are not", "[apps][singular]") {
    const TemporaryFolder folder;
    json job = pendulum_job(32768);
    job["orbits"]["periods"] = {1, 2, 3, 4, 5};
    job["estimate"]["parameters"]["m"] = json::parse(R"({ "start": 0.1, "prior": { "normal": { "mean": 0.1,
                                                          "sd": 0.01 } } })");
    const Path out = folder.path() / "out";
    REQUIRE(orbid_with({"run", write_job(folder.path() / "job.json", job), "--out", out}).code == 0);
    const json ratio = read_json(out / "result.json")["derived"]["k2_over_m"];
    CHECK(std::abs(ratio["value"].get<double>() - 5.652680652680653e-3) < 4.0 * ratio["sd"].get<double>());
    // 10 % of m are no uncertainty of the ratio.
    CHECK(ratio["sd"].get<double>() < 1e-3 * ratio["value"].get<double>());
}

}  // namespace singular_sets_test
