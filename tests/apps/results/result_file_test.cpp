#include "apps/results/result_file.hpp"

#include <limits>
#include <sstream>
#include <string>

#include <nlohmann/json.hpp>

#include "tests/apps/results/made_up_estimate.hpp"
#include "tests/catch.hpp"

namespace orbid::result_file_test {
namespace {

using tests::WithinRel;

TEST_CASE("result.json has every key of the contract", "[apps]") {
    const auto json = nlohmann::json::parse(apps::result_text(tests::made_up_estimate(), tests::made_up_context()));
    for (const char* pointer : {"/format",
                                "/status",
                                "/message",
                                "/parameters/l/value",
                                "/parameters/l/sd",
                                "/parameters/l/interval95/1",
                                "/parameters/l/interval_method",
                                "/parameters/l/start",
                                "/parameters/l/reference",
                                "/parameters/l/relative_deviation",
                                "/parameters/l/unit",
                                "/parameters/l/at_bound",
                                "/derived/c2_over_m/value",
                                "/derived/c2_over_m/at_bound",
                                "/errors/cycles.phi/sd",
                                "/errors/cycles.phi/factor",
                                "/errors/cycles.phi/uncertainty",
                                "/errors/cycles.phi/unit",
                                "/errors/cycles.phi/count",
                                "/initial_states/0",
                                "/prediction/0/experiment",
                                "/prediction/0/segment",
                                "/prediction/0/rms/phi",
                                "/prediction/0/normalised_rms",
                                "/correlation/names/2",
                                "/correlation/matrix/2/2",
                                "/identifiability/singular_values/2",
                                "/identifiability/null_directions/0",
                                "/identifiability/trust_normal",
                                "/identifiability/effective_count",
                                "/residuals/0/type",
                                "/residuals/0/used",
                                "/residuals/0/lost",
                                "/residuals/0/rejected",
                                "/residuals/0/added",
                                "/objective",
                                "/log_likelihood",
                                "/degrees_of_freedom",
                                "/iterations",
                                "/evaluations",
                                "/orbits/found/1",
                                "/orbits/missing/0",
                                "/data/points",
                                "/data/segments",
                                "/data/captured/0"}) {
        CAPTURE(pointer);
        CHECK(json.contains(nlohmann::json::json_pointer(pointer)));
    }
    CHECK(json["format"] == "orbid-result/1");
    CHECK(json["status"] == "singular");
    CHECK(json["orbits"]["found"] == nlohmann::json({{"1", 6}, {"2", 9}}));
    CHECK(json["orbits"]["missing"] == nlohmann::json::array({3}));
}

TEST_CASE("undefined numbers of a result are null", "[apps]") {
    const auto json = nlohmann::json::parse(apps::result_text(tests::made_up_estimate(), tests::made_up_context()));
    const auto& c2 = json["parameters"]["c2"];
    CHECK(c2["sd"].is_null());
    CHECK(c2["interval95"].is_null());
    CHECK(c2["relative_deviation"].is_null());  // from a reference of 0
    CHECK(c2["reference"] == 0.0);
    CHECK(c2["at_bound"] == "lower");
    CHECK(json["parameters"]["l"]["at_bound"].is_null());
    CHECK(json["parameters"]["m"]["reference"].is_null());
    CHECK(json["correlation"]["matrix"][1][1].is_null());
    CHECK(json["errors"]["cycles.phi"]["lag1"].is_null());
}

TEST_CASE("the interval of a result is the estimate's, the error scale in the data's unit", "[apps]") {
    const auto json = nlohmann::json::parse(apps::result_text(tests::made_up_estimate(), tests::made_up_context()));
    CHECK(json["parameters"]["m"]["interval_method"] == "sandwich");
    CHECK(json["parameters"]["m"]["interval95"] == nlohmann::json({0.066, 0.106}));
    CHECK(json["errors"]["cycles.phi"]["sd"] == 1.1e-6);
    CHECK(json["errors"]["cycles.phi"]["factor"] == 1.02);
    CHECK(json["errors"]["series.phi"]["sd"] == 1.136e-3);
    CHECK(json["errors"]["series.phi"]["factor"].is_null());
    // (0.3170012 - 0.317) / 0.317; the bound is the rounding of the subtraction, 1e-16 / 1.2e-6, times ten.
    CHECK_THAT(json["parameters"]["l"]["relative_deviation"].get<double>(), WithinRel(1.2e-6 / 0.317, 1e-9));
}

TEST_CASE("the verdict tells of a bias that stays in", "[apps]") {
    estimator::Estimate estimate;
    estimate.status = estimator::EstimateStatus::converged;
    estimate.remaining = 0.0;
    const auto verdict = [&] { return nlohmann::json::parse(apps::result_text(estimate, {}))["verdict"]; };
    CHECK(verdict()["trust"] == "all");
    estimate.bias_left = "no pair of records with further errors gave two estimates";
    CHECK(verdict()["trust"] == "values");
    CHECK(verdict()["because"] ==
          nlohmann::json({"readings err by more than the course's folds, and their bias is not "
                          "taken off: no pair of records with further errors gave two estimates"}));
}

TEST_CASE("null directions name their parameters, without zeros, largest first", "[apps]") {
    const auto estimate = tests::made_up_estimate();
    const auto json = nlohmann::json::parse(apps::result_text(estimate, {}));
    CHECK(json["identifiability"]["null_directions"] == nlohmann::json::array({{{"c2", 1.0}, {"m", -0.5}}}));
    const auto named = apps::named_components({Eigen::Vector3d(0.5, 1.0, -1.0 - 1e-9)}, estimate.parameters);
    REQUIRE(named.size() == 3);
    CHECK(named[0].first == "c2");  // as large as m up to rounding: the order of the parameters
    CHECK(named[1].first == "m");
    CHECK(named[2].first == "l");
}

TEST_CASE("a failed estimate with nothing in it can be stored", "[apps]") {
    estimator::Estimate estimate;
    estimate.message = "nothing to fit";
    const auto json = nlohmann::json::parse(apps::result_text(estimate, {}));
    CHECK(json["status"] == "failed");
    CHECK(json["parameters"].is_object());
    CHECK(json["correlation"]["matrix"].is_array());
    CHECK_FALSE(json.contains("fingerprint"));
}

TEST_CASE("residuals.csv reads back to the bit, undefined cells are empty", "[apps]") {
    const double third = 1.0 / 3.0;
    const double undefined = std::numeric_limits<double>::quiet_NaN();
    std::istringstream text(apps::residuals_text(
        {{"run1", "segment, \"a\"", "phi", third, -1e-300, 2.0, undefined}, {"", "12", "phi_dot", 0, 1, 2, 3}}));
    std::string line;
    std::getline(text, line);
    CHECK(line == "experiment,segment_or_cycle,coordinate,time_or_phase,observed,predicted,sd");
    std::getline(text, line);
    const std::string start = "run1,\"segment, \"\"a\"\"\",phi,";
    REQUIRE(line.substr(0, start.size()) == start);
    CHECK(std::stod(line.substr(start.size())) == third);
    CHECK(line.substr(line.size() - 11) == ",-1e-300,2,");
    std::getline(text, line);
    CHECK(line == ",12,phi_dot,0,1,2,3");
    CHECK_FALSE(std::getline(text, line));
}

}  // namespace
}  // namespace orbid::result_file_test
