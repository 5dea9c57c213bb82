// Jobs against the same identification from C++, without JSON: equal numbers, bit for bit.

#include <cmath>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "identification/strategy/identify.hpp"
#include "models/catalogue/registry.hpp"
#include "orbits/records/series_file.hpp"
#include "orbits/simulation/virtual_experiment.hpp"
#include "tests/apps/program/program.hpp"
#include "tests/catch.hpp"
#include "tests/source_folder.hpp"

namespace identify_job_test {

using namespace orbid;
using namespace orbid::tests;

namespace {

json result_of(const TemporaryFolder& folder, const json& job) {
    const Outcome run =
        orbid_with({"run", write_job(folder.path() / "job.json", job), "--out", folder.path() / "out", "--quiet"});
    CAPTURE(run.error);
    REQUIRE(run.code == 0);
    return read_json(folder.path() / "out" / "result.json");
}

/// The shortest decimals in result.json read back to the same doubles.
void check_same(const json& job, const estimator::Estimate& library) {
    CHECK(job["status"] == std::string(estimator::name(library.status)));
    CHECK(job["status"] == "converged");
    CHECK(job["objective"].get<double>() == library.objective);
    CHECK(job["iterations"].get<int>() == library.iterations);
    REQUIRE(job["parameters"].size() == library.parameters.size());
    for (const estimator::Estimated& parameter : library.parameters) {
        CAPTURE(parameter.name);
        REQUIRE(job["parameters"].contains(parameter.name));
        const json& of_job = job["parameters"][parameter.name];
        CHECK(of_job["value"].get<double>() == parameter.value);
        CHECK(of_job["sd"].get<double>() == parameter.sd);
        CHECK(of_job["start"].get<double>() == parameter.start);
    }
    REQUIRE(job["errors"].size() == library.scales.size());
    for (const estimator::EstimatedScale& scale : library.scales) {
        CAPTURE(scale.group);
        REQUIRE(job["errors"].contains(scale.group));
        CHECK(job["errors"][scale.group]["sd"].get<double>() == scale.value);
    }
}

}  // namespace

TEST_CASE("hare and lynx from C++ are those of the job", "[apps][run]") {
    const TemporaryFolder folder;
    json job = json::parse(apps::read_whole_file(source_folder() + "/configs/hare_lynx.json"), nullptr, true, true);
    const std::string file = source_folder() + "/configs/data/hare_lynx/hare_lynx.csv";
    job["data"]["file"] = file;
    job["estimate"].erase("marginals");
    job["estimate"].erase("posterior");

    using estimator::LogNormalPrior;
    using estimator::NormalPrior;
    identification::IdentificationProblem problem;
    problem.system = models::make_system("lotka_volterra");
    const auto add = [&](const char* name, double start, const NormalPrior& prior) {
        problem.parameters.push_back(identification::free_parameter(*problem.system, name, start));
        problem.parameters.back().value.prior = prior;
    };
    // In the order of the job in the test, whose keys are sorted.
    add("alpha", 0.5, {1.0, 0.5});
    add("beta", 0.03, {0.05, 0.05});
    add("delta", 0.03, {0.05, 0.05});
    add("gamma", 0.8, {1.0, 0.5});

    orbits::TableLayout layout;
    layout.sampling = orbits::Series::Sampling::samples;
    layout.time = "t";
    for (const auto& [index, column] : {std::pair{0, "hare"}, std::pair{1, "lynx"}}) {
        const models::Coordinate& entry = problem.coordinate(index);
        layout.coordinates.push_back({{std::string(entry.name), std::string(entry.unit), false}, column, {}});
    }
    identification::Experiment pelts;
    pelts.name = "pelts";
    pelts.series = std::make_shared<const orbits::Series>(orbits::read_csv(file, layout));
    pelts.initial_state.resize(2);
    // A job takes the logarithm of what has such a prior; in C++ it is said.
    for (identification::InitialValue& initial : pelts.initial_state) {
        initial.prior = LogNormalPrior{10.0, 1.0};
        initial.scale = estimator::Scale::log;
        initial.lower = 0.0;
    }
    problem.experiments.push_back(pelts);

    // One free initial state, errors by a factor.
    auto& series = problem.series.emplace();
    series.matching.kind = identification::Matching::Kind::exact;
    for (Eigen::Index coordinate = 0; coordinate < 2; ++coordinate)
        series.errors.push_back(
            {coordinate, {true, 0.0, LogNormalPrior{0.36787944117144233, 1.0}}, estimator::LogNormalErrors{}, 0.0, {}});
    identification::Options options;
    options.strategy = {{identification::Stage::Kind::residuals, {identification::ResidualType::series}}};

    const auto library = identification::identify(problem, options);
    CHECK(library.estimate.parameters.size() == 6);
    check_same(result_of(folder, job), library.estimate);
}

TEST_CASE("an automatic strategy from C++ is that of the job", "[apps][run]") {
    const TemporaryFolder folder;
    identification::IdentificationProblem problem;
    problem.system = models::make_system("henon");
    orbits::VirtualExperimentOptions experiment;
    experiment.plan = orbits::SectionPlan{400, 100, {}, 0.0};
    experiment.initial = Eigen::Vector2d(0.1, 0.1);
    experiment.noise = Eigen::Vector2d(1e-3, 1e-3);
    const orbits::Series record = orbits::simulate(*problem.system, Eigen::Vector2d(1.4, 0.3), experiment).series;
    const Path file = folder.path() / "record.csv";
    orbits::write_csv(file, record);

    json job = json::parse(R"({
      "model": { "name": "henon" },
      "seed": 7,
      "data": { "name": "run1", "kind": "section", "columns": { "segment": "segment", "x": "x", "y": "y" } },
      "estimate": { "parameters": { "a": { "start": 1.54 }, "b": { "start": 0.27 } }, "strategy": "auto" } })");
    job["data"]["file"] = file;

    problem.experiments.emplace_back();
    problem.experiments.back().name = "run1";
    problem.experiments.back().series = std::make_shared<const orbits::Series>(record);
    problem.parameters = {identification::free_parameter(*problem.system, "a", 1.54),
                          identification::free_parameter(*problem.system, "b", 0.27)};
    identification::Options options;
    options.seed = 7;

    const auto library = identification::identify(problem, options);
    const json result = result_of(folder, job);
    check_same(result, library.estimate);
    REQUIRE(result["stages"].size() == library.stages.size());
    for (std::size_t i = 0; i < library.stages.size(); ++i) {
        CHECK(result["stages"][i]["stage"] == library.stages[i].stage);
        CHECK(result["stages"][i]["objective"].get<double>() == library.stages[i].objective);
        CHECK(result["stages"][i]["iterations"].get<int>() == library.stages[i].iterations);
    }
    const auto& shift = library.matching.at(0).shift;
    REQUIRE(shift.size() == 2);
    for (const auto& [name, value] : shift)
        CHECK(result["matching"][0]["looser_shift_in_sds"][name].get<double>() == value);
}

// N. van de Wouw, G. Verbeek, D. H. van Campen, J. Vibration and Control 1:291-305 (1995), section 5, from fewer
// points.
TEST_CASE("the paper's experiment from C++ is that of the job", "[apps][run]") {
    const TemporaryFolder folder;
    json job =
        json::parse(apps::read_whole_file(source_folder() + "/configs/pendulum_experiment.json"), nullptr, true, true);
    constexpr std::size_t sections = 300;
    job["data"]["simulate"]["sections"] = sections;

    identification::IdentificationProblem problem;
    problem.system = models::make_system("parametric_pendulum", "crank");
    const json& values = job["model"]["parameters"];  // all of them
    problem.values.resize(static_cast<Eigen::Index>(values.size()));
    for (const auto& [name, value] : values.items())
        problem.values[problem.system->parameter_index(name)] = value.get<double>();
    models::Sensor encoder;
    encoder.type = models::Sensor::Type::angle_difference;
    encoder.delay = 0.01508;
    encoder.step = 1.5339807878856412e-3;
    encoder.rounding = models::Sensor::Rounding::nearest;
    orbits::VirtualExperimentOptions experiment;
    experiment.plan = orbits::SectionPlan{sections, 20, {}, 0.0};
    experiment.trajectories = 4;
    experiment.sensor = encoder;
    experiment.seed = 1;
    problem.experiments.emplace_back();
    identification::Experiment& run1 = problem.experiments.back();
    run1.name = "run1";
    run1.sensor = encoder;
    run1.follows_model = true;
    run1.series =
        std::make_shared<const orbits::Series>(orbits::simulate(*problem.system, problem.values, experiment).series);

    // Two readings of the angle, each rounded to the encoder's step, stand behind a point.
    const double q = encoder.step * encoder.step / 12.0;
    const double d = encoder.delay;
    auto& measured = problem.measured;
    measured.options.symmetry_signs = std::vector{-1.0, -1.0};
    measured.options.reading_covariance = Eigen::MatrixXd{{q, -q / d}, {-q / d, 2.0 * q / (d * d)}};
    measured.search = orbits::find_cycles(*run1.series, measured.options);
    measured.experiment = 0;
    measured.section = run1.series;
    // Cycles are asked for.
    problem.cycles.emplace().sensor = encoder;
    problem.series.emplace().interval = identification::SeriesChoice::automatic_interval;
    const auto add = [&](const char* name, double start, double lower, double upper) {
        problem.parameters.push_back(identification::free_parameter(*problem.system, name, start));
        problem.parameters.back().value.lower = lower;
        problem.parameters.back().value.upper = upper;
    };
    // In the order of the job in the test, whose keys are sorted.
    add("k1", 2.0e-4, 0.0, 0.1);
    add("k2", 1.7e-3, 0.0, 0.1);
    add("k3", 4.0e-5, 0.0, 0.1);
    add("l", 0.45, 0.1, 2.0);

    const auto library = identification::identify(problem, identification::Options{});
    check_same(result_of(folder, job), library.estimate);
    CHECK(library.stages.size() == 4);
    CHECK(std::abs(library.estimate.parameters[3].value - 0.317) < 4.0 * library.estimate.parameters[3].sd);
}

}  // namespace identify_job_test
