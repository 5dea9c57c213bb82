// Orbits of a model in a job: what is found instead of an orbit, searches, branches, and what a second run takes up.

#include <chrono>
#include <cmath>
#include <csignal>
#include <thread>

#include <fmt/format.h>

#include "tests/apps/program/program.hpp"
#include "tests/catch.hpp"
#include "tests/source_folder.hpp"

namespace periodic_run_test {

using namespace orbid::tests;

namespace {

/// A job in a folder of its own.
struct Run {
    TemporaryFolder folder;
    Outcome outcome;
    [[nodiscard]] Path out() const { return folder.path() / "out"; }
    [[nodiscard]] json orbits() const { return read_json(out() / "orbits.json")["cycles"]; }
};

void run(Run& run, const std::string& job) {
    const Path file = write_text(run.folder.path() / "job.json", job);
    run.outcome = orbid_with({"periodic", file, "--out", run.out(), "--force"});
}

bool reused(const Run& run, const std::string& name) {
    const json timing = read_json(run.out() / "timing.json");
    for (const json& stage : timing["stages"])
        if (stage["stage"] == name) return stage["reused"];
    return false;
}

}  // namespace

TEST_CASE("what was found instead of an orbit is said", "[apps][run]") {
    Run pendulum;
    run(pendulum, R"({ "model": { "name": "parametric_pendulum" },
      "periodic": { "maximum_distance": 0.01, "orbits": [
        { "period": 1, "points": [[2.9, 6.2]] },
        { "period": 2, "points": [[2.9667, 6.4066], [2.9668, 6.4065]] },
        { "period": 1, "rotation": 4, "points": [[2.9667, 6.4066]] },
        { "period": 1, "points": [[2.9667, 6.4066]] } ] } })");
    CAPTURE(pendulum.outcome.error, pendulum.outcome.out);
    CHECK(pendulum.outcome.code == 0);
    const json orbits = pendulum.orbits();
    // tests/reference/pendulum_orbits_g9.81.json: the rotation through (2.966784, 6.406582).
    CHECK(orbits[0]["status"] == "other_orbit");
    CHECK_THAT(
        orbits[0]["message"].get<std::string>(),
        ContainsSubstring("an orbit of period 1 with rotation +1 through (2.96678, 6.40658), 0.033 of the scale"));
    CHECK_THAT(orbits[0]["distance"].get<double>(), WithinAbs((6.406582448 - 6.2) / 6.2, 1e-4));
    CHECK(orbits[1]["status"] == "shorter_period");
    CHECK_THAT(orbits[1]["message"].get<std::string>(), ContainsSubstring("an orbit of period 1 with rotation +1"));
    CHECK(orbits[2]["status"] == "other_orbit");
    CHECK_THAT(orbits[2]["message"].get<std::string>(),
               ContainsSubstring("none with the rotation +4 asked for: an orbit of period 1 with rotation +1 through "
                                 "(2.96678, 6.40658)"));
    CHECK(orbits[3]["status"] == "converged");
    CHECK(orbits[3]["message"].is_null());
    CHECK_THAT(pendulum.outcome.out, ContainsSubstring("Found instead") && ContainsSubstring("orbit 1: an orbit of"));
    CHECK_THAT(pendulum.outcome.error, ContainsSubstring("1 of 4 converged"));

    // Nothing at all: exit code 1, and a file that says why.
    Run lorenz;
    run(lorenz, R"({ "model": { "name": "lorenz" }, "section": { "coordinate": "z", "value": 27 },
      "periodic": { "orbits": [ { "period": 1, "points": [[8.6, 8.4, 27]] } ] } })");
    CHECK(lorenz.outcome.code == 1);
    CHECK(lorenz.orbits()[0]["status"] == "equilibrium");
    CHECK_THAT(lorenz.orbits()[0]["message"].get<std::string>(),
               ContainsSubstring("it does not move: an equilibrium at (8.48528, 8.48528, 27)"));
}

TEST_CASE("stability of orbits stands in orbits.json", "[apps][run]") {
    Run henon;
    run(henon, R"({ "model": { "name": "henon" },
      "periodic": { "stability": true, "free": ["b", "a"], "orbits": [ { "period": 1, "points": [[0.6, 0.2]] } ] } })");
    CHECK(henon.outcome.code == 0);
    const json file = read_json(henon.out() / "orbits.json");
    CHECK(file["parameters"] == json({"b", "a"}));
    const json& orbit = file["cycles"][0];
    // x = (b - 1 + sqrt((1 - b)^2 + 4 a)) / (2 a) with y = b x; multipliers mu^2 + 2 a x mu - b = 0, product -b:
    // ln|mu_1| + ln|mu_2| = ln b, whatever a.
    CHECK(orbit["unstable"] == 1);
    CHECK(orbit["bifurcation_near"] == "none");
    const json& derivatives = orbit["ln_multiplier_sensitivities"];
    CHECK_THAT(derivatives[0][0].get<double>() + derivatives[1][0].get<double>(), WithinRel(1.0 / 0.3, 1e-12));
    CHECK_THAT(derivatives[0][1].get<double>() + derivatives[1][1].get<double>(), WithinAbs(0.0, 1e-12));
    const double x = (0.3 - 1.0 + std::sqrt(0.49 + 5.6)) / 2.8;
    CHECK_THAT(orbit["points"][0][0].get<double>(), WithinAbs(x, 1e-14));
    // The direction of mu is (mu, b): x' = -2 a x dx + dy, y' = b dx.
    const double mu = orbit["multipliers"][0][0];
    const json& direction = orbit["directions"][0][0];
    CHECK_THAT(direction[1][0].get<double>() / direction[0][0].get<double>(), WithinRel(0.3 / mu, 1e-10));
}

TEST_CASE("an orbit of an autonomous flow needs no section but its time", "[apps][run]") {
    Run flow;
    run(flow, R"({ "model": { "name": "van_der_pol", "parameters": { "mu": 1.0 } },
      "periodic": { "stability": true, "orbits": [ { "points": [[2, 0.1]], "time": 6.5 } ] } })");
    CAPTURE(flow.outcome.out);
    CHECK(flow.outcome.code == 0);
    const json orbit = flow.orbits()[0];
    CHECK(orbit["status"] == "converged");
    // T for mu = 1: 6.66328685930313 (J. H. E. Cartwright et al., Int. J. Bifurcation and Chaos 9:2219, 1999,
    // has 6.6633).
    CHECK_THAT(orbit["time"].get<double>(), WithinAbs(6.6633, 5e-5));
    CHECK(orbit["period"] == 1);
    CHECK(orbit["points"].size() == 1);
    CHECK(orbit["sensitivities"].size() == 2);
    CHECK(orbit["times"].size() == 1);
    CHECK(orbit["directions"].size() == 1);
    CHECK(orbit["time_sensitivities"].size() == 1);
    CHECK_THAT(orbit["trivial_multiplier"][0].get<double>(), WithinAbs(1.0, 1e-10));
    CHECK_THAT(flow.outcome.out, ContainsSubstring("time [s]") && ContainsSubstring("6.6632868"));
}

TEST_CASE("all orbits of a map up to a period are found, stored with a picture and taken up again", "[apps][run]") {
    Run search;
    const std::string job = R"({ "model": { "name": "henon" }, "seed": 3,
      "periodic": { "search": { "periods": [1, 2, 3, 4, 5, 6], "points": 20000 }, "free": [] } })";
    run(search, job);
    CAPTURE(search.outcome.error, search.outcome.out);
    CHECK(search.outcome.code == 0);
    std::map<int, int> counts;
    const json found = search.orbits();
    for (const json& orbit : found) {
        CHECK(orbit["status"] == "converged");
        CHECK(orbit["origin"] != "start");
        ++counts[orbit["period"]];
    }
    // tests/reference: 2, 1, 0, 1, 0, 2 prime orbits (the two fixed points, the second off the attractor).
    CHECK(counts == std::map<int, int>{{1, 2}, {2, 1}, {4, 1}, {6, 2}});
    CHECK_THAT(search.outcome.out, ContainsSubstring("Periodic orbits found by the search"));
    const std::string picture = orbid::apps::read_whole_file(search.out() / "section.svg");
    CHECK_THAT(picture, ContainsSubstring("6 periodic orbits of the model") && ContainsSubstring("period 6: 2 orbits"));

    const Outcome first = search.outcome;
    run(search, job);
    CHECK(reused(search, "periodic"));
    CHECK(search.outcome.out == first.out);
    CHECK(search.orbits() == found);
    // The seed matters to a search.
    std::string other = job;
    run(search, other.replace(other.find("\"seed\": 3"), 9, "\"seed\": 4"));
    CHECK_FALSE(reused(search, "periodic"));
}

TEST_CASE("a search that finds nothing ends with exit code 1", "[apps][run]") {
    Run nothing;
    // The only orbits of this map are its fixed point and the one at infinity: r = 0.5 contracts to 0.
    run(nothing, R"({ "model": { "name": "logistic", "parameters": { "r": 0.5 } },
      "periodic": { "search": { "periods": [3], "points": 1000 } } })");
    CAPTURE(nothing.outcome.error, nothing.outcome.out);
    CHECK(nothing.outcome.code == 1);
    CHECK_THAT(nothing.outcome.out, ContainsSubstring("none found"));
    CHECK(nothing.orbits().empty());
}

TEST_CASE("the doublings of the logistic map are located along its branches", "[apps][run]") {
    Run cascade;
    const std::string job = R"({ "title": "logistic", "model": { "name": "logistic", "parameters": { "r": 2.8 } },
      "periodic": { "orbits": [ { "period": 1, "points": [[0.6]] } ],
        "continuation": { "parameter": "r", "to": 3.56, "maximum_period": 4 } } })";
    run(cascade, job);
    CAPTURE(cascade.outcome.error, cascade.outcome.out);
    CHECK(cascade.outcome.code == 0);
    const json file = read_json(cascade.out() / "branch.json");
    CHECK(file["format"] == "orbid-branches/1");
    CHECK(file["parameter"]["name"] == "r");
    REQUIRE(file["branches"].size() == 3);
    REQUIRE(file["cascades"].size() == 1);
    const json& doublings = file["cascades"][0]["parameter"];
    REQUIRE(doublings.size() == 3);
    CHECK_THAT(doublings[0].get<double>(), WithinAbs(3.0, 1e-12));
    CHECK_THAT(doublings[1].get<double>(), WithinAbs(1.0 + std::sqrt(6.0), 1e-12));
    // Root of a polynomial of degree 12: Kotsireas and Karamanos, Int. J. Bifurcation and Chaos 14:2417 (2004).
    CHECK_THAT(doublings[2].get<double>(), WithinAbs(3.544090359551922853615965986, 1e-12));
    CHECK_THAT(file["cascades"][0]["ratios"][0].get<double>(),
               WithinAbs((std::sqrt(6.0) - 2.0) / 0.0946006167687447, 1e-9));
    // Before the doubling the fixed point 1 - 1 / r with multiplier 2 - r.
    for (const json& point : file["branches"][0]["points"]) {
        const double r = point["parameter"];
        CHECK_THAT(point["points"][0][0].get<double>(), WithinAbs(1.0 - 1.0 / r, 1e-12));
        // Ten times the error of a point, which the multiplier follows.
        CHECK_THAT(point["multipliers"][0][0].get<double>(), WithinAbs(2.0 - r, 1e-11));
        if (point["bifurcation"].is_null()) CHECK(point["unstable"] == (r > 3.0 ? 1 : 0));
    }
    CHECK(file["branches"][1]["origin"][0] == 0);
    CHECK_THAT(cascade.outcome.out, ContainsSubstring("period doubling of branch 0") &&
                                        ContainsSubstring("end of the range") && ContainsSubstring("3.44948974278") &&
                                        ContainsSubstring("4.7514"));
    const std::string table = orbid::apps::read_whole_file(cascade.out() / "branch.csv");
    CHECK_THAT(table, ContainsSubstring("branch,point,r,arclength,period,time,unstable,bifurcation,multiplier_re,"
                                        "multiplier_im,section,x,frequency,x_max,x_min,x_mean,x_half_range,x_rms\n"
                                        "0,0,2.8,0,1,"));
    CHECK_THAT(orbid::apps::read_whole_file(cascade.out() / "branch.svg"),
               ContainsSubstring("<title>logistic</title>") && ContainsSubstring("period doubling"));

    // Another step: the orbits are those of the folder, the branches not; the same job: both.
    const Outcome first = cascade.outcome;
    run(cascade, job);
    CHECK(reused(cascade, "periodic"));
    CHECK(reused(cascade, "branches"));
    CHECK(cascade.outcome.out == first.out);
    std::string finer = job;
    run(cascade, finer.replace(finer.find("\"to\": 3.56"), 10, "\"to\": 3.55"));
    CHECK(reused(cascade, "periodic"));
    CHECK_FALSE(reused(cascade, "branches"));
}

TEST_CASE("a branch without a start says so and ends with exit code 1", "[apps][run]") {
    Run lost;
    run(lost, R"({ "model": { "name": "parametric_pendulum" }, "periodic": {
        "orbits": [ { "period": 1, "points": [[2.96, 6.4]] }, { "period": 1, "rotation": 9, "points": [[2.96, 6.4]] } ],
        "continuation": { "parameter": "omega", "to": 9.2, "orbit": 1 } } })");
    CHECK(lost.outcome.code == 1);
    const json file = read_json(lost.out() / "branch.json");
    CHECK(file["branches"].empty());
    CHECK_THAT(file["message"].get<std::string>(), ContainsSubstring("orbit 1 is no start: "));
    CHECK_THAT(lost.outcome.out, ContainsSubstring("none: orbit 1 is no start"));
    CHECK_FALSE(std::filesystem::exists(lost.out() / "branch.svg"));
}

TEST_CASE("the pendulum's cascade runs from its configuration", "[apps][run]") {
    const TemporaryFolder folder;
    const Path out = folder.path() / "out";
    const Outcome outcome =
        orbid_with({"run", orbid::tests::source_folder() + "/configs/pendulum_cascade.json", "--out", out, "--quiet"});
    CAPTURE(outcome.out);
    CHECK(outcome.code == 0);
    const json file = read_json(out / "branch.json");
    REQUIRE(file["branches"].size() == 5);
    REQUIRE(file["cascades"].size() == 1);
    const json& doublings = file["cascades"][0];
    REQUIRE(doublings["parameter"].size() == 5);
    for (const json& error : doublings["parameter_error"])
        CHECK(error.get<double>() < 1e-8);
    for (std::size_t k = 0; k < 5; ++k) {
        const json& place = doublings["doublings"][k];
        const json& orbit = file["branches"][place[0].get<std::size_t>()]["points"][place[1].get<std::size_t>()];
        CHECK(orbit["bifurcation"] == "period_doubling");
        CHECK(orbit["period"] == (1 << k));
        CHECK_THAT(orbit["multipliers"][0][0].get<double>(), WithinAbs(-1.0, 1e-9));
    }
    // On the way to 4.669.
    CHECK_THAT(doublings["ratios"].back().get<double>(), WithinRel(4.669, 0.2));
    // The locked rotation at 9.09 rad/s: tests/reference/pendulum_orbits_g9.81.json.
    const json& end = file["branches"][0]["points"].back();
    CHECK(end["parameter"] == 9.09);
    CHECK_THAT(end["points"][0][0].get<double>(), WithinAbs(2.966784281971485, 1e-10));
    CHECK_THAT(end["points"][0][1].get<double>(), WithinAbs(6.406582448046664, 1e-9));
}

TEST_CASE("an interrupted run keeps the orbits it has and is not taken up again", "[apps][run]") {
    const TemporaryFolder folder;
    const Path out = folder.path() / "out";
    json job = json::parse(R"({ "model": { "name": "parametric_pendulum" },
      "periodic": { "method": "collocation", "orbits": [],
                    "continuation": { "parameter": "omega", "to": 9.2 } } })");
    // Some 20 ms each: the signal comes before the last of them.
    for (int k = 0; k < 400; ++k)
        job["periodic"]["orbits"].push_back({{"period", 1}, {"points", {{2.96, 6.40}}}});
    const Path file = write_job(folder.path() / "job.json", job);
    Outcome interrupted;
    // On a busy machine the signal may come before the first of them: then nothing is stored, and it is tried again.
    for (int attempt = 0; attempt < 10 && !std::filesystem::exists(out / "orbits.json"); ++attempt) {
        std::filesystem::remove_all(out);
        // Should the run have ended when the signal comes, the test shall fail, not the whole process end.
        std::signal(SIGINT, SIG_IGN);
        std::thread user([&] {
            while (!std::filesystem::exists(out))
                std::this_thread::sleep_for(std::chrono::milliseconds(1));
            std::raise(SIGINT);
        });
        interrupted = orbid_with({"periodic", file, "--out", out, "--quiet"});
        user.join();
        std::signal(SIGINT, SIG_DFL);
    }
    CHECK(interrupted.code == 130);
    const json stored = read_json(out / "orbits.json");
    CHECK_FALSE(stored.contains("fingerprint"));
    REQUIRE(stored["cycles"].size() == 400);
    int missing = 0;
    for (const json& orbit : stored["cycles"]) {
        if (orbit["status"] == "converged") continue;
        CHECK(orbit["status"] == "interrupted");
        CHECK(orbit["points"] == json::parse("[[2.96, 6.40]]"));
        ++missing;
    }
    CHECK(missing > 0);
    CHECK_FALSE(std::filesystem::exists(out / "branch.json"));
}

TEST_CASE("what a check says of periodic orbits", "[apps][command]") {
    const Outcome check = orbid_with({"check", orbid::tests::source_folder() + "/configs/lorenz_orbits.json"});
    CHECK(check.code == 0);
    CHECK_THAT(
        check.out,
        ContainsSubstring("periodic   1 orbit of 2 points by multiple shooting, with stability") &&
            ContainsSubstring("search     periods 1, 2, 3, 4 of the model: 16384 points of the section") &&
            ContainsSubstring("branches   rho from 24 to 32 1/s, orbits up to period 2; at most 32 branches of"));
}

}  // namespace periodic_run_test
