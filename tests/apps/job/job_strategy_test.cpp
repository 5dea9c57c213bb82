// Strategies, nodes and matching of series, multipliers, criticism: what is read, written and refused.

#include <string>
#include <vector>

#include "apps/job/estimate_job.hpp"
#include "apps/job/reading/job_reader.hpp"
#include "apps/job/writing/job_writer.hpp"
#include "apps/program/check/job_summary.hpp"
#include "tests/apps/job/job_problems.hpp"
#include "tests/catch.hpp"

namespace job_strategy_test {

using namespace orbid;
using namespace orbid::apps;
using tests::check_only;
using tests::ContainsSubstring;
using tests::job_folder;
using tests::problems;

namespace {

/// The pendulum's virtual experiment, sections read by an encoder; `estimate` is the inside of "estimate".
std::string experiment_job(const std::string& estimate, const std::string& orbits = "\"periods\": [1, 2]") {
    return R"({ "model": { "name": "parametric_pendulum", "variant": "crank" },
  "data": { "name": "run1", "simulate": { "sections": 1024 },
    "sensor": { "type": "angle_difference", "angle": "phi", "rate": "phi_dot", "delay": 0.015, "step": 0.0015 } },
  "orbits": { )" +
           orbits + R"( },
  "estimate": { "parameters": { "l": { "start": 0.3 }, "k1": { "start": 1e-3 }, "k3": { "start": 1e-4 } },
)" + estimate +
           "\n} }";
}

/// Samples of the Lorenz equations; `series` is put into the residual, `rest` behind the residuals.
std::string samples_job(const std::string& series, const std::string& rest = "") {
    return R"({ "model": { "name": "lorenz" },
  "data": { "name": "run1", "simulate": { "samples": { "step": 0.01, "count": 101 }, "initial": [[1, 0, 0]] } },
  "estimate": { "parameters": { "rho": { "start": 27 } },
    "residuals": [ { "type": "series")" +
           (series.empty() ? "" : ",\n" + series) + " } ]" + (rest.empty() ? "" : ",\n" + rest) + " } }";
}

Job read(const std::string& text) {
    const auto found = problems(text);
    CAPTURE(text, found);
    REQUIRE(found.empty());
    return *read_job(text, job_folder / "job.json").job;
}

/// Read, and its complete form reads back to the same.
EstimateJob read_back(const std::string& text) {
    const Job job = read(text);
    const std::string written = job_text(job, job_folder);
    const auto again = read_job(written, job_folder / "job.json");
    CAPTURE(written);
    REQUIRE(again.job);
    CHECK(job_text(*again.job, job_folder) == written);
    return *again.job->estimate;
}

std::vector<std::string> stages(const EstimateJob& estimate) {
    std::vector<std::string> names;
    for (const StageJob& stage : estimate.strategy)
        names.push_back(stage.name());
    return names;
}

using Names = std::vector<std::string>;

}  // namespace

TEST_CASE("a strategy is a list of stages, or chosen by what the job has", "[apps][job]") {
    const EstimateJob all = read_back(experiment_job(R"("strategy": "auto")"));
    CHECK(stages(all) == Names{"prediction", "series", "cycles", "harvest", "series"});
    for (std::size_t i = 0; i < all.strategy.size(); ++i)
        CHECK(all.strategy[i].if_needed == (i > 1));
    REQUIRE(all.cycles);
    CHECK(all.cycles->periods == std::vector<int>{1, 2});
    REQUIRE(all.series);
    CHECK(all.series->data == std::vector<std::size_t>{0});
    CHECK(all.series->interval == SeriesResidualJob::automatic_interval);
    // The second reading of the angle has the errors of the first.
    REQUIRE(all.series->errors.size() == 1);
    CHECK(all.series->errors[0].coordinate == 0);
    CHECK_FALSE(all.scan);

    const EstimateJob named =
        read_back(experiment_job(R"("residuals": [ { "type": "series" } ], "strategy": "auto", "scan": true)"));
    CHECK(stages(named) == Names{"prediction", "series"});
    CHECK(named.scan);
    CHECK_FALSE(named.cycles);

    // Cycles that are asked for are used.
    CHECK(stages(read_back(
              experiment_job(R"("residuals": [ { "type": "cycles" }, { "type": "series" } ], "strategy": "auto")"))) ==
          Names{"prediction", "cycles", "harvest", "series"});

    const std::string both = R"("residuals": [ { "type": "cycles" }, { "type": "series" } ])";
    CHECK(stages(read_back(experiment_job(both))) == Names{"cycles + series"});
    CHECK(stages(read_back(experiment_job(both + R"(, "strategy": ["series", "cycles"])"))) ==
          Names{"series", "cycles"});
    CHECK(
        stages(read_back(experiment_job(both + R"(, "strategy": ["prediction", ["cycles", "series"], "harvest"])"))) ==
        Names{"prediction", "cycles + series", "harvest"});
    const EstimateJob needed =
        read_back(experiment_job(both + R"(, "strategy": ["series", { "if_needed": [["cycles", "series"]] }])"));
    CHECK(stages(needed) == Names{"series", "cycles + series"});
    CHECK_FALSE(needed.strategy[0].if_needed);
    CHECK(needed.strategy[1].if_needed);
    CHECK(stages(read_back(samples_job(""))) == Names{"series"});
    CHECK(stages(read_back(samples_job("", R"("strategy": "auto")"))) == Names{"prediction", "series"});

    CHECK_THAT(
        job_summary(read(experiment_job(R"("strategy": "auto", "scan": true)"))),
        ContainsSubstring("l, k1, k3 from prediction with a scan, then series, then if needed cycles, then if needed "
                          "harvest, then if needed series") &&
            ContainsSubstring("series     run1: nodes as far apart as errors allow"));
}

TEST_CASE("strategies that cannot be meant are refused with place and rule", "[apps][job]") {
    const std::string cycles = R"("residuals": [ { "type": "cycles" } ], )";
    const auto refused = [](const std::string& estimate, const std::string& message) {
        check_only(experiment_job(estimate), "job.json:6: /estimate" + message);
    };
    check_only(experiment_job(R"("strategy": ["cycles"])"), "job.json:5: /estimate: \"residuals\" is missing");
    refused(cycles + R"("strategy": "all")", "/strategy: must be \"auto\" or a list");
    refused(cycles + R"("strategy": [])", "/strategy: must not be empty");
    refused(cycles + R"("strategy": ["prediction"])",
            "/strategy: must name every type of \"residuals\": there is no \"cycles\"");
    refused(cycles + R"("strategy": ["cycles", "series"])", "/strategy/1: there is no residual of type series");
    refused(cycles + R"("strategy": ["cycles", "cycles"])", "/strategy/1: \"cycles\" is listed twice");
    refused(cycles + R"("strategy": ["cycles", "prediction"])",
            "/strategy/1: the prediction gives a start: it must be");
    refused(cycles + R"("strategy": ["harvest", "cycles"])", "/strategy/0: must come after \"cycles\"");
    refused(cycles + R"("strategy": ["cycles", "harvets"])",
            "/strategy/1: unknown value \"harvets\"; did you mean \"harvest\"?");
    refused(cycles + R"("strategy": ["cycles", []])", "/strategy/1: must not be empty");
    const std::string both = R"("residuals": [ { "type": "cycles" }, { "type": "series" } ], )";
    refused(both + R"("strategy": ["cycles", { "if_needed": ["series"] }])",
            "/strategy/1: needs a stage \"series\" before it, which may be enough");
    refused(both + R"("strategy": ["series", { "if_needed": ["cycles"] }, "harvest"])",
            "/strategy/2: must not follow the stages that are run if needed");
    refused(both + R"("strategy": ["series", { "if_needed": ["cycles", "cycles"] }])",
            "/strategy/1/if_needed/1: \"cycles\" is listed twice");
    refused(both + R"("strategy": ["series", {}])", "/strategy/1: \"if_needed\" is missing");
    refused(cycles + R"("scan": true)", "/scan: belongs to the stage \"prediction\"");
    refused(R"("strategy": "auto", "scan": 1)", "/scan: must be true or false");
    check_only(R"({ "model": { "name": "lorenz" }, "estimate": { "parameters": {}, "strategy": "auto" } })",
               "/estimate/strategy: \"auto\" needs \"data\", or \"orbits\" with a file of cycles");
}

TEST_CASE("several starts go with one stage and with several", "[apps][job]") {
    for (const char* strategy : {R"("series")", R"("prediction", "series")"}) {
        const auto estimate = read_back(samples_job(
            "", std::string(R"("strategy": [)") + strategy + R"(], "multi_start": { "starts": 3, "seed": 5 })"));
        CHECK(estimate.multi_start.starts == 3);
        CHECK(estimate.multi_start.seed == 5);
    }
}

TEST_CASE("nodes and matching of a series are read, with what is usual where nothing is said", "[apps][job]") {
    using Kind = MatchingJob::Kind;
    struct Row {
        const char* text;
        std::optional<std::size_t> interval;
        Kind kind;
        double sd;
        bool unless_errors_grow = false;
    };
    const std::vector<Row> rows{
        // One trajectory per segment, as long as nothing asks for more and errors do not grow.
        {"", std::nullopt, Kind::automatic, 0.0, true},
        {R"("matching": "exact", "interval": "segment")", std::nullopt, Kind::exact, 0.0},
        {R"("matching": "exact")", std::nullopt, Kind::exact, 0.0, true},
        {R"("interval": "auto")", 0, Kind::automatic, 0.0},
        {R"("interval": 25)", 25, Kind::automatic, 0.0},
        {R"("interval": 1, "matching": "exact")", 1, Kind::exact, 0.0},
        {R"("matching": { "sd": "estimate" })", 0, Kind::estimated, 0.0},
        {R"("matching": { "sd": 1e-4 }, "interval": 5)", 5, Kind::given, 1e-4},
    };
    for (const Row& row : rows) {
        CAPTURE(row.text);
        const SeriesResidualJob series = *read_back(samples_job(row.text)).series;
        CHECK(series.interval == row.interval);
        CHECK(series.matching.kind == row.kind);
        CHECK(series.matching.sd == row.sd);
        CHECK(series.unless_errors_grow == row.unless_errors_grow);
    }
    CHECK(read_back(samples_job("", R"("strategy": "auto")")).series->interval == std::size_t{0});
    // Sections have no other way; the data of a series are the samples where there are some.
    CHECK(read_back(experiment_job(R"("residuals": [ { "type": "series" } ])")).series->interval == std::size_t{0});

    const std::string at = "job.json:5: /estimate/residuals/0";
    const auto refused = [&](const std::string& series, const std::string& message) {
        check_only(samples_job(series), at + message);
    };
    refused(R"("interval": 0)", "/interval: must be a whole number from 1");
    refused(R"("interval": 2.5)", "/interval: must be a whole number from 1");
    refused(R"("interval": "segments")", "/interval: unknown value \"segments\"; did you mean \"segment\"?");
    refused(R"("interval": true)", "/interval: must be a whole number or \"auto\", \"segment\"");
    refused(R"("matching": "exactly")", "/matching: unknown value \"exactly\"");
    refused(R"("matching": 0.1)", "/matching: must be \"exact\", \"auto\" or { \"sd\":");
    refused(R"("matching": { "sd": 0 })", "/matching/sd: must be > 0 and <= 1, not 0");
    refused(R"("matching": { "sd": "guess" })", "/matching/sd: must be a number");
    refused(R"("matching": {})", "/matching: \"sd\" is missing");
    refused(R"("matching": { "sd": 0.1 }, "interval": "segment")", "/matching: nothing is matched where the flow runs");
    check_only(samples_job(R"("interval": 5, "errors": { "x": { "distribution": "ar1" } })"),
               "/estimate/residuals/0: errors \"ar1\" last over many intervals");
    check_only(samples_job(R"("interval": 5, "covariance": ["x", "y"])"), "/estimate/residuals/0: a full covariance");
    check_only(experiment_job(R"("residuals": [ { "type": "series", "interval": "segment" } ])"),
               "/estimate/residuals/0/interval: holds for samples");
    check_only(experiment_job(R"("residuals": [ { "type": "series", "errors": { "phi_dot": { "sd": 1 } } } ])"),
               "\"phi_dot\" is not observed: it has no errors");
    std::string held = samples_job(R"("interval": 5)");
    held.insert(held.find("\"simulate\""), R"("initial_state": { "x": { "value": 1 } }, )");
    check_only(held, "job.json:5: /estimate/residuals/0/interval: \"initial_state\" of \"run1\" goes with");
}

TEST_CASE("multipliers of cycles are data when asked for", "[apps][job]") {
    const auto job = [](const std::string& cycles) {
        return experiment_job("\"residuals\": [ { \"type\": \"cycles\"" + (cycles.empty() ? "" : ", " + cycles) +
                              " } ]");
    };
    CHECK(read_back(job("")).cycles->positions);
    CHECK_FALSE(read_back(job("")).cycles->multipliers);
    const CyclesResidualJob both = *read_back(job(R"("multipliers": true)")).cycles;
    CHECK(both.multipliers);
    CHECK(both.multiplier_error.estimate);
    CHECK(both.multiplier_error.value == 0.0);
    const CyclesResidualJob alone =
        *read_back(job(R"("positions": false, "multipliers": true, "errors": { "ln_multiplier": { "sd": 2 } })"))
             .cycles;
    CHECK_FALSE(alone.positions);
    CHECK_FALSE(alone.multiplier_error.estimate);
    CHECK(alone.multiplier_error.value == 2.0);
    const CyclesResidualJob known =
        *read_back(
             job(R"("multipliers": true, "errors": { "ln_multiplier": { "sd": { "estimate": { "start": 0.1, "prior": { "lognormal": { "median": 1, "log_sd": 1 } } } } } })"))
             .cycles;
    CHECK(known.multiplier_error.value == 0.1);
    CHECK(std::holds_alternative<estimator::LogNormalPrior>(known.multiplier_error.prior));

    const std::string at = "job.json:6: /estimate/residuals/0";
    check_only(job(R"("positions": false)"), at + "/positions: must be true without \"multipliers\": true");
    check_only(job(R"("multipliers": 1)"), at + "/multipliers: must be true or false");
    check_only(job(R"("errors": { "ln_multiplier": { "sd": 1 } })"),
               at + "/errors/ln_multiplier: needs \"multipliers\": true");
    check_only(job(R"("multipliers": true, "errors": { "ln_multiplier": { "sd": 0 } })"),
               at + "/errors/ln_multiplier/sd: must be > 0, not 0");
    check_only(job(R"("multipliers": true, "errors": { "ln_multiplier": { "distribution": "laplace" } })"),
               at + "/errors/ln_multiplier/distribution: unknown value \"laplace\"");
}

TEST_CASE("criticism names models and parameters that exist", "[apps][job]") {
    const auto with = [](const std::string& criticism) {
        return experiment_job("\"strategy\": \"auto\", \"criticism\": " + criticism);
    };
    const CriticismJob criticism =
        read_back(
            with(
                R"({ "variants": ["crank", "crank_as_printed", "harmonic"], "without": ["k1", "k3"], "held_out": 0.2 })"))
            .criticism;
    CHECK(criticism.variants == Names{"crank_as_printed", "harmonic"});
    CHECK(criticism.without.size() == 2);
    CHECK(criticism.held_out == 0.2);
    CHECK_FALSE(read_back(experiment_job("\"strategy\": \"auto\"")).criticism.any());
    CHECK_THAT(job_summary(read(with(R"({ "variants": ["harmonic"], "without": ["k1"], "held_out": 0.25 })"))),
               ContainsSubstring("against    variant harmonic, without k1") &&
                   ContainsSubstring("held out   0.25 of the data"));

    const std::string at = "job.json:6: /estimate/criticism";
    const auto refused = [&](const std::string& text, const std::string& message) {
        check_only(with(text), at + message);
    };
    refused("{}", ": names nothing to compare");
    refused(R"({ "variants": ["cranc"] })", "/variants/0: unknown value \"cranc\"; did you mean \"crank\"?");
    refused(R"({ "variants": ["crank"] })", "/variants: \"crank\" is the job's own variant");
    refused(R"({ "variants": ["harmonic", "harmonic"] })", "/variants/1: \"harmonic\" is listed twice");
    refused(R"({ "variant": ["harmonic"] })", "/variant: unknown key");
    refused(R"({ "without": ["k2"] })", "/without/0: \"k2\" is not estimated");
    refused(R"({ "without": ["l"] })", "/without/0: l (");
    refused(R"({ "held_out": 0.6 })", "/held_out: must be >= 0 and <= 0.5, not 0.6");
    refused(R"({ "held_out": true })", "/held_out: must be a number");
    check_only(samples_job("", R"("criticism": { "variants": ["other"] })"),
               "/estimate/criticism/variants: the model lorenz has no other variants");
}

}  // namespace job_strategy_test
