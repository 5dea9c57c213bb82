// The example of the whole posterior against reference draws (posteriordb, hudson_lynx_hare-lotka_volterra: means and
// sds of 10 x 1000 draws, tests/reference/posteriordb_notice.md).

#include <cmath>
#include <sstream>
#include <string>
#include <vector>

#include "tests/apps/program/program.hpp"
#include "tests/catch.hpp"
#include "tests/source_folder.hpp"

namespace hare_lynx_job_test {

using namespace orbid::tests;

namespace {

struct Reference {
    std::string block;  ///< of "posterior"
    std::string name;
    double mean;
    double sd;
};

const std::vector<Reference>& references() {
    static const std::vector<Reference> list{
        {"parameters", "alpha", 0.546864, 0.063055},      {"parameters", "beta", 0.027747, 0.004155},
        {"parameters", "gamma", 0.800095, 0.08937},       {"parameters", "delta", 0.024086, 0.003528},
        {"parameters", "u_0@pelts", 34.035222, 2.916899}, {"parameters", "v_0@pelts", 5.935897, 0.530552},
        {"errors", "series.u.scale", 0.248057, 0.043263}, {"errors", "series.v.scale", 0.251017, 0.04359}};
    return list;
}

}  // namespace

TEST_CASE("the posterior of hare and lynx is that of the reference draws", "[apps][run]") {
    const TemporaryFolder folder;
    json job = json::parse(orbid::apps::read_whole_file(orbid::tests::source_folder() + "/configs/hare_lynx.json"),
                           nullptr, true, true);
    job["data"]["file"] = orbid::tests::source_folder() + "/configs/data/hare_lynx/hare_lynx.csv";
    constexpr double draws = 4 * 250;
    job["estimate"]["posterior"]["sample"] = {{"draws", 250}, {"chains", 4}, {"warm_up", 250}};
    const Path out = folder.path() / "out";
    const Outcome run = orbid_with({"run", write_job(folder.path() / "job.json", job), "--out", out});
    CAPTURE(run.error, run.out);
    REQUIRE(run.code == 0);
    const json result = read_json(out / "result.json");
    CHECK(result["status"] == "converged");
    for (const Reference& reference : references()) {
        CAPTURE(reference.name);
        // Nested Laplace: what the method is held to, a tenth of a sd and 5 % of it.
        const json& marginal = result["marginals"][reference.name];
        CHECK(std::abs(marginal["mean"].get<double>() - reference.mean) < 0.1 * reference.sd);
        CHECK_THAT(marginal["sd"].get<double>(), WithinRel(reference.sd, 0.05));
        // Draws: four Monte-Carlo errors of these and of the reference (10000 draws).
        const json& sampled = result["posterior"][reference.block][reference.name];
        const double mean_error = std::hypot(sampled["mean_error"].get<double>(), reference.sd / 100.0);
        CHECK(std::abs(sampled["mean"].get<double>() - reference.mean) < 4.0 * mean_error);
        const double sd_error = std::hypot(sampled["sd_error"].get<double>(), reference.sd / 141.0);
        CHECK(std::abs(sampled["sd"].get<double>() - reference.sd) < 4.0 * sd_error);
    }
    CHECK(result["errors"]["series.u"]["distribution"] == "lognormal");
    CHECK(result["errors"]["series.u"]["unit"] == "1");
    CHECK(result["log_evidence"]["value"].is_number());
    CHECK(result["diagnostics"]["series.u"]["count"] == 21);
    CHECK(result["diagnostics"]["series.v"]["outliers"].is_array());
    CHECK(result["initial_states"][0]["state"]["u"]["sd"] == result["parameters"]["u_0@pelts"]["sd"]);
    for (const char* heading : {"Marginal densities", "Posterior sample", "Residuals", "lognormal"}) {
        CHECK_THAT(run.out, ContainsSubstring(heading));
    }
    std::istringstream table(orbid::apps::read_whole_file(out / "posterior.csv"));
    std::string line;
    std::getline(table, line);
    // The test's own copy of the job has its keys sorted.
    CHECK(line ==
          "chain,draw,alpha,beta,delta,gamma,u_0@pelts,v_0@pelts,series.u.scale,series.v.scale,minus_log_density");
    int rows = 0;
    while (std::getline(table, line))
        ++rows;
    CHECK(rows == draws);
}

}  // namespace hare_lynx_job_test
