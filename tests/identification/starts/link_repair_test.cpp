// Links that ended on a wrong branch, against the course that made the record.

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <memory>
#include <string>
#include <vector>

#include "estimator/exploration/replication.hpp"
#include "identification/problem/estimated_values.hpp"
#include "identification/starts/link_gaps.hpp"
#include "identification/starts/link_repair.hpp"
#include "identification/starts/series_nodes.hpp"
#include "models/catalogue/registry.hpp"
#include "orbits/simulation/virtual_experiment.hpp"
#include "tests/catch.hpp"

namespace link_repair_test {

using namespace orbid;
using namespace orbid::tests;
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

const VectorXd truth{{0.25, -1.0, 1.0, 0.3}};  // delta, alpha, beta, gamma
const Eigen::Vector2d noise{0.0145, 0.0075};   // 5e-3 of the ranges

/// Sections of Duffing's chaotic oscillator. Errors of readings grow a hundredfold over some periods.
struct Record {
    identification::IdentificationProblem problem;
    MatrixXd course;  ///< states at the sections
    identification::EstimateSetup setup;
    identification::ProblemResiduals residuals;
    estimator::EstimateOptions options;

    Record() {
        problem.system = models::make_system("duffing");
        orbits::VirtualExperimentOptions experiment;
        experiment.plan = orbits::SectionPlan{300, 50, {}, 0.0};
        experiment.initial = Eigen::Vector2d(0.5, 0.0);
        experiment.seed = 4;
        VectorXd all = problem.system->default_parameters();
        const std::vector<std::string> names{"delta", "alpha", "beta", "gamma"};
        for (std::size_t i = 0; i < names.size(); ++i) {
            all[problem.system->parameter_index(names[i])] = truth[static_cast<Index>(i)];
            problem.parameters.push_back(
                identification::free_parameter(*problem.system, names[i], truth[static_cast<Index>(i)]));
        }
        course = orbits::simulate(*problem.system, all, experiment).series.segments[0].values;
        experiment.noise = noise;
        problem.experiments.emplace_back();
        problem.experiments[0].name = "run";
        problem.experiments[0].series =
            std::make_shared<const orbits::Series>(orbits::simulate(*problem.system, all, experiment).series);
        problem.experiments[0].follows_model = true;
        problem.series.emplace();
        problem.series->data = {0};
        problem.series->interval = 1;
        problem = identification::completed(problem);
        setup = identification::estimate_setup(problem, identification::fitted_labels(problem));
    }

    /// The estimate with nodes that begin at these states.
    [[nodiscard]] estimator::Estimate estimate_from(const MatrixXd& nodes) {
        identification::SeriesStart start;
        start.theta = truth;
        start.intervals = {1};
        start.nodes = {{nodes}};
        start.follows = true;
        residuals = {};
        identification::add_shooting(problem, setup, start, residuals);
        return estimator::estimate(setup.parameters, residuals.all(), {}, options);
    }

    [[nodiscard]] std::size_t missed(const estimator::Estimate& estimate) const {
        return residuals.shooting[0]
            ->defect(estimate.active[0], identification::estimated_theta(estimate), estimate.latents[0])
            .large;
    }

    [[nodiscard]] estimator::Estimate mended(const estimator::Estimate& estimate, std::string& said) const {
        return identification::with_mended_links(problem, setup, setup.parameters, residuals, options, estimate,
                                                 [&](const std::string& line) { said += line + "\n"; });
    }
};

}  // namespace

TEST_CASE("links on wrong branches are mended", "[identification][series]") {
    Record record;
    const estimator::Estimate right = record.estimate_from(record.course);
    REQUIRE(right.status == estimator::EstimateStatus::converged);
    REQUIRE(record.missed(right) == 0);
    const estimator::Estimate wrong = record.estimate_from(record.problem.experiments[0].series->segments[0].values);
    REQUIRE(wrong.status == estimator::EstimateStatus::converged);
    REQUIRE(record.missed(wrong) >= 2);
    CHECK(wrong.objective > right.objective + 20.0);
    std::string said;
    const estimator::Estimate mended = record.mended(wrong, said);
    CHECK(mended.status == estimator::EstimateStatus::converged);
    CHECK(record.missed(mended) == 0);
    CHECK_THAT(said, ContainsSubstring("have a better one: the objective decreases by"));
    // The same minimum as from the course that made the record.
    CHECK_THAT(mended.objective, WithinAbs(right.objective, 0.5));
    for (std::size_t i = 0; i < 4; ++i) {
        const estimator::Estimated& one = mended.parameters[i];
        CAPTURE(one.name, one.value, one.sd);
        CHECK(std::abs(one.value - truth[static_cast<Index>(i)]) < 4.0 * one.sd);
        CHECK(std::abs(one.value - right.parameters[i].value) < 0.1 * one.sd);
    }
}

TEST_CASE("a course that meets all nodes is left as it is", "[identification][series]") {
    Record record;
    const estimator::Estimate right = record.estimate_from(record.course);
    REQUIRE(record.missed(right) == 0);
    std::string said;
    const estimator::Estimate same = record.mended(right, said);
    CHECK(said.empty());
    CHECK(same.objective == right.objective);
    CHECK(same.evaluations == right.evaluations);
}

TEST_CASE("a course misses where links or readings are beyond their errors", "[identification][series]") {
    Record record;
    estimator::Estimate estimate = record.estimate_from(record.course);
    const orbits::ShootingResidual& residual = *record.residuals.shooting[0];
    const auto missed = [&] { return identification::missed_places(residual, estimate, 0); };
    REQUIRE(missed().empty());
    const double sd = identification::scale_of(estimate, "series.x")->value;
    const double before = estimate.residuals[0][100].e[0];
    estimate.residuals[0][100].e[0] = 4.4 * sd;
    CHECK(missed().empty());
    estimate.residuals[0][100].e[0] = -4.6 * sd;
    CHECK(missed() == std::vector<std::size_t>{100});
    estimate.active[0].groups[0].distribution = estimator::StudentErrors{};
    CHECK(missed().empty());  // heavy tails are expected
    estimate.residuals[0][100].e[0] = before;
    const double slack = residual.matching_sd(estimate.active[0])[0];
    estimate.residuals[0][200].e[2] = 3.1 * slack;
    CHECK(missed() == std::vector<std::size_t>{200});
    // The last node is looked at with the one before.
    estimate.active[0].groups[0].distribution = estimator::NormalErrors{};
    estimate.residuals[0].back().e[0] = 5.0 * sd;
    CHECK(missed() == std::vector<std::size_t>{200, residual.layout().size() - 2});
}

TEST_CASE("links become as tight as the errors of readings ask for that are left", "[identification][series]") {
    Record record;
    const estimator::Estimate estimate = record.estimate_from(record.course);
    const orbits::ShootingResidual& residual = *record.residuals.shooting[0];
    const auto with_errors = [&](double times) {
        std::vector<estimator::ActiveSet> sets = estimator::ended_sets(estimate);
        for (std::size_t g = 0; g < residual.reading_groups(); ++g)
            sets[0].groups[g].scale.value *= times;
        return sets[0];
    };
    const VectorXd before = residual.matching_sd(estimate.active[0]);
    estimator::ActiveSet set = with_errors(0.9);
    CHECK_FALSE(residual.tighten(set));
    CHECK(residual.matching_sd(set) == before);
    set = with_errors(0.5);
    CHECK(residual.tighten(set));
    CHECK_FALSE(set.is_intermediate_stage);
    // Slack is the square of the errors here.
    const double errors = residual.noise(set);
    double largest = 0.0;
    for (std::size_t g = 0; g < residual.reading_groups(); ++g)
        largest = std::max(largest, set.groups[g].scale.value / residual.reading_range(g));
    CHECK(errors == largest);
    CHECK_THAT(residual.matching_sd(set)[0], WithinRel(12.0 * errors * errors * residual.range()[0], 1e-12));
    CHECK(set.groups[residual.reading_groups()].scale.value == residual.matching_sd(set)[0]);
    CHECK_FALSE(residual.tighten(set));

    // As after an estimate whose wrong branches have made errors look twice as large.
    estimator::Estimate loose = estimate;
    loose.active[0].memory.front() *= 2.0;
    std::string said;
    const estimator::Estimate tight = record.mended(loose, said);
    CHECK(tight.status == estimator::EstimateStatus::converged);
    CHECK(residual.noise(tight.active[0]) < 0.7 * residual.noise(loose.active[0]));
    CHECK(residual.matching_sd(tight.active[0])[0] < residual.matching_sd(loose.active[0])[0]);
    for (std::size_t i = 0; i < 4; ++i)
        CHECK(std::abs(tight.parameters[i].value - estimate.parameters[i].value) < 0.3 * estimate.parameters[i].sd);
    record.options.interrupted = [] { return true; };
    CHECK(record.mended(loose, said).status == estimator::EstimateStatus::interrupted);
}

TEST_CASE("what is stopped while links are mended is no minimum", "[identification][series]") {
    Record record;
    const estimator::Estimate wrong = record.estimate_from(record.problem.experiments[0].series->segments[0].values);
    REQUIRE(record.missed(wrong) >= 2);
    record.options.interrupted = [] { return true; };
    std::string said;
    const estimator::Estimate stopped = record.mended(wrong, said);
    CHECK(stopped.status == estimator::EstimateStatus::interrupted);
    CHECK(stopped.objective == wrong.objective);
    CHECK(said.empty());
}

}  // namespace link_repair_test
