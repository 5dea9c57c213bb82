#include <limits>

#include <tbb/global_control.h>

#include "tests/catch.hpp"
#include "tests/orbits/cycle_residuals/cycle_case.hpp"

namespace cycle_residual_test {

using namespace orbid;
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using estimator::BlockStatus;
using estimator::BlockValue;
using tests::CycleCase;

namespace {

const std::vector<VectorXd> no_latents;

/// Largest difference between the derivatives of all blocks and central differences of their values, relative to the
/// largest derivative. `step` relative to each parameter.
double derivative_error(const estimator::Residual& residual, const VectorXd& theta,
                        const std::vector<VectorXd>& latents, double step) {
    const std::vector<BlockValue> at = residual.evaluate(residual.initial_set(), theta, latents, true);
    double worst = 0.0;
    for (Index k = 0; k < theta.size(); ++k) {
        VectorXd up = theta;
        VectorXd down = theta;
        const double h = step * theta(k);
        up(k) += h;
        down(k) -= h;
        const auto above = residual.evaluate(residual.initial_set(), up, latents, false);
        const auto below = residual.evaluate(residual.initial_set(), down, latents, false);
        for (std::size_t b = 0; b < at.size(); ++b) {
            REQUIRE(at[b].status == BlockStatus::ok);
            REQUIRE(above[b].status == BlockStatus::ok);
            const VectorXd difference = (above[b].e - below[b].e) / (2.0 * h);
            worst = std::max(worst, (difference - at[b].e_theta.col(k)).cwiseAbs().maxCoeff() /
                                        at[b].e_theta.col(k).cwiseAbs().maxCoeff());
        }
    }
    return worst;
}

}  // namespace

TEST_CASE("one-period residual: zero at the truth, exact derivatives", "[orbits]") {
    const CycleCase c({{"l", 1.1}, {"k2", 2.0}, {"omega", 1.01}});
    const auto cycles = tests::measured_cycles(c.table, 0.0 + 1e-300, 1);  // exact points
    orbits::CycleTargetOptions equal;
    equal.weights = orbits::CycleWeights::equal;
    orbits::OnePeriodOptions options;
    options.targets = equal;
    std::vector<orbits::Cycle> bare = cycles;
    for (orbits::Cycle& cycle : bare)
        cycle.covariance.resize(0, 0);
    const orbits::OnePeriodResidual residual(c.system, c.binding, bare, 0.0, tests::starts(c.parameters), options);
    REQUIRE(residual.layout().size() == 41);
    REQUIRE(residual.groups().size() == 2);
    CHECK(residual.groups()[0].name == "one_period.phi");
    CHECK(residual.groups()[1].unit == "rad/s");
    for (const BlockValue& block : residual.evaluate(residual.initial_set(), c.truth(), no_latents, true)) {
        REQUIRE(block.status == BlockStatus::ok);
        // Flow tolerance 1e-10, amplified by at most 60 over a period, some 50 steps.
        CHECK(block.e.cwiseAbs().maxCoeff() < 1e-8);
    }
    // Differences of step 1e-5: truncation 1e-10 x third derivative (1e4 over a chaotic period).
    CHECK(derivative_error(residual, tests::starts(c.parameters), no_latents, 1e-5) < 1e-4);
    CHECK(residual.misfit(c.truth()) < 1e-9);
    CHECK(residual.misfit(tests::starts(c.parameters)) > 10.0);
}

TEST_CASE("lifted residual: measurement and matching records, exact derivatives", "[orbits]") {
    const CycleCase c({{"l", 1.02}, {"k3", 0.7}});
    const auto cycles = tests::measured_cycles(c.table, 1e-3, 1);
    const VectorXd start = tests::starts(c.parameters);
    orbits::LiftedCycleOptions loose;
    loose.matching_start = 0.01;
    const orbits::LiftedCycleResidual residual(c.system, c.binding, cycles, 0.0, start, loose);
    estimator::ActiveSet active = residual.initial_set();
    REQUIRE(residual.groups().size() == 3);
    CHECK(residual.groups()[0].name == "cycles.points");
    CHECK_FALSE(residual.groups()[0].scale.estimate);
    CHECK(residual.groups()[2].name == "matching.phi_dot");
    CHECK(residual.groups()[2].scale.value == 0.01 * residual.scale()(1));
    CHECK(active.is_intermediate_stage);
    CHECK(residual.structure() == estimator::LatentStructure::independent_blocks);

    std::vector<VectorXd> latents = residual.initial_latents();
    for (std::size_t b = 0; b < latents.size(); ++b) {
        const estimator::BlockLayout& block = residual.layout()[b];
        REQUIRE(block.latents == latents[b].size());
        REQUIRE(block.group.size() == static_cast<std::size_t>(2 * block.latents));
    }
    const auto at = residual.evaluate(residual.initial_set(), start, latents, true);
    const std::size_t b = 20;
    CHECK(at[b].e.head(latents[b].size()).isZero());  // nodes on the measured points
    CHECK(derivative_error(residual, start, latents, 1e-5) < 1e-4);
    for (Index k = 0; k < latents[b].size(); ++k) {
        auto up = latents;
        auto down = latents;
        up[b](k) += 1e-6;
        down[b](k) -= 1e-6;
        const VectorXd difference = (residual.evaluate(residual.initial_set(), start, up, false)[b].e -
                                     residual.evaluate(residual.initial_set(), start, down, false)[b].e) /
                                    2e-6;
        // Truncation 1e-12 x third derivative, rounding 1e-10 / 1e-6 on derivatives of the order of 50.
        CHECK((difference - at[b].e_z.col(k)).cwiseAbs().maxCoeff() < 1e-3);
    }

    CHECK(residual.nodes(active, latents)[cycles.size() - 1].cols() == 3);
    CHECK(residual.nodes(active, latents)[2].size() == 0);  // (0, 0): at rest

    int rounds = 0;
    while (active.is_intermediate_stage) {
        CHECK(residual.update_active_set(active, start, latents, {}).changed);
        ++rounds;
    }
    CHECK(rounds == 6);  // tenfold from 1e-2 to 1e-8
    CHECK(active.groups[1].scale.value == 1e-8 * residual.scale()(0));
    CHECK_FALSE(residual.update_active_set(active, start, latents, {}).changed);
    const orbits::LiftedCycleResidual told(c.system, c.binding, cycles, 0.0, start);
    const VectorXd defect = residual.matching_defect(active, start, latents).cwiseQuotient(residual.scale());
    CHECK(told.groups()[1].scale.value == defect.maxCoeff() * residual.scale()(0));

    const auto refused = [&](const orbits::LiftedCycleOptions& options, const std::string& rule) {
        CHECK_THROWS_WITH(orbits::LiftedCycleResidual(c.system, c.binding, cycles, 0.0, start, options),
                          tests::ContainsSubstring(rule));
    };
    loose.matching_factor = 1.0;
    refused(loose, "matching_factor");
    loose.matching_factor = 0.1;
    loose.matching_end = 0.0;
    refused(loose, "matching_end");
    loose.matching_end = 1e-8;
    loose.matching_start = -1.0;
    refused(loose, "matching_start");
}

TEST_CASE("cycle residual: the error of the points at the truth, exact derivatives", "[orbits]") {
    const CycleCase c({{"l", 1.0}, {"m", 1.0}, {"omega", 1.0}});
    const auto cycles = tests::measured_cycles(c.table, 1e-5, 1);
    const orbits::CycleResidual residual(c.system, c.binding, cycles, 0.0, c.truth());
    REQUIRE(residual.layout().size() == 41);
    CHECK(residual.at_rest() == std::vector<std::size_t>{2, 5});
    CHECK(residual.groups()[0].name == "cycles.phi");
    CHECK(residual.groups()[0].unit == "1");
    const auto exact = tests::measured_cycles(c.table, 1e-300, 1);
    const auto at = residual.evaluate(residual.initial_set(), c.truth(), no_latents, true);
    for (std::size_t b = 0; b < at.size(); ++b) {
        const std::size_t cycle = residual.cycle_of(b);
        CAPTURE(cycle);
        REQUIRE(at[b].status == BlockStatus::ok);
        // The error of a computed orbit (1e-10 of the range, against 1e-5) is added: a share of 1e-10.
        CHECK(residual.layout()[b].shape.isApprox(cycles[cycle].covariance, 2e-10));
        const VectorXd error = (cycles[cycle].points - exact[cycle].points).reshaped();
        // The computed orbit is good to 1e-11 (tests/periodic), one digit is added for its flow tolerance of 1e-12.
        CHECK((at[b].e - error).cwiseAbs().maxCoeff() < 1e-10);
    }
    // Truncation (1e-6)^2 x third derivative relative to the first (1e4), rounding 1e-11 / 1e-6.
    CHECK(derivative_error(residual, c.truth(), no_latents, 1e-6) < 1e-4);
}

TEST_CASE("cycle residual: same bytes with any number of threads", "[orbits][threads]") {
    const CycleCase c({{"l", 1.0}, {"k2", 1.0}});
    const auto cycles = tests::measured_cycles(c.table, 1e-4, 1);
    const orbits::CycleResidual residual(c.system, c.binding, cycles, 0.0, c.truth());
    const VectorXd theta = c.truth() * 1.001;
    const auto several = residual.evaluate(residual.initial_set(), theta, no_latents, true);
    const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
    const auto alone = residual.evaluate(residual.initial_set(), theta, no_latents, true);
    for (std::size_t b = 0; b < alone.size(); ++b) {
        CHECK(alone[b].e == several[b].e);
        CHECK(alone[b].e_theta == several[b].e_theta);
    }
}

TEST_CASE("cycle residual: weights equal use the coordinate's unit and no shape", "[orbits]") {
    const CycleCase c({{"l", 1.0}});
    auto cycles = tests::measured_cycles(c.table, 1e-4, 1);
    for (orbits::Cycle& cycle : cycles)
        cycle.covariance.resize(0, 0);
    orbits::CycleResidualOptions options;
    options.targets.weights = orbits::CycleWeights::equal;
    options.targets.periods = {2};
    options.targets.errors = {{false, 0.01, estimator::FlatPrior{}}, {true, 0.1, estimator::FlatPrior{}}};
    const orbits::CycleResidual residual(c.system, c.binding, cycles, 0.0, c.truth(), {}, options);
    CHECK(residual.layout().size() == 9);
    CHECK(residual.layout()[0].shape.size() == 0);
    CHECK(residual.groups()[1].unit == "rad/s");
    CHECK_FALSE(residual.groups()[1].factor);
    CHECK(residual.groups()[0].scale.value == 0.01);
}

TEST_CASE("cycle residual: lost orbits are missing data and come back", "[orbits]") {
    const CycleCase c({{"l", 1.0}});
    const auto cycles = tests::measured_cycles(c.table, 1e-6, 1);
    const orbits::CycleResidual residual(c.system, c.binding, cycles, 0.0, c.truth());
    const VectorXd scales = VectorXd::Ones(2);
    estimator::ActiveSet active = residual.initial_set();
    CHECK_FALSE(residual.update_active_set(active, c.truth(), {}, scales).changed);

    const VectorXd far = 1.3 * c.truth();
    int failed = 0;
    for (const BlockValue& block : residual.evaluate(active, far, no_latents, false))
        failed += block.status == BlockStatus::failed ? 1 : 0;
    CHECK(failed > 0);
    CHECK(failed < 41);

    active.layout.edit()[7].active = false;
    const auto report = residual.update_active_set(active, c.truth(), {}, scales);
    CHECK(report.changed);
    CHECK(report.added == 1);
    CHECK(active.layout[7].active);

    const auto lost = residual.update_active_set(active, far, {}, VectorXd::Constant(2, 1e9));
    CHECK(lost.lost == failed);

    // Out of the domain of l: everything failed, nothing thrown.
    for (const BlockValue& block : residual.evaluate(active, VectorXd::Zero(1), no_latents, true)) {
        const bool empty_or_failed = block.status == BlockStatus::failed || block.e.size() == 0;
        CHECK(empty_or_failed);
    }
}

TEST_CASE("cycle residual: states of rest are left out with dry friction too", "[orbits]") {
    CycleCase c({{"l", 1.0}});
    c.binding.base(c.system->parameter_index("k1")) = 1e-3;
    auto cycles = tests::measured_cycles(c.table, 1e-6, 1);
    const orbits::CycleResidual residual(c.system, c.binding, cycles, 0.0, c.truth());
    const std::vector<std::size_t>& at_rest = residual.at_rest();
    CHECK(std::count(at_rest.begin(), at_rest.end(), std::size_t{2}) == 1);
    CHECK(std::count(at_rest.begin(), at_rest.end(), std::size_t{5}) == 1);
}

TEST_CASE("cycle residuals refuse what makes no sense", "[orbits]") {
    const CycleCase c({{"l", 1.0}});
    const auto good = tests::measured_cycles(c.table, 1e-6, 1);
    const auto refused = [&](const std::vector<orbits::Cycle>& cycles, const orbits::CycleResidualOptions& options,
                             const std::vector<MatrixXd>& nodes, const std::string& rule) {
        CHECK_THROWS_WITH(orbits::CycleResidual(c.system, c.binding, cycles, 0.0, c.truth(), nodes, options),
                          tests::ContainsSubstring(rule));
    };
    auto cycles = good;
    cycles[3].points.resize(3, 1);
    refused(cycles, {}, {}, "cycle 3: points have shape (3, 1)");
    cycles = good;
    cycles[1].points(0, 0) = std::numeric_limits<double>::quiet_NaN();
    refused(cycles, {}, {}, "cycle 1: points must be finite");
    cycles = good;
    cycles[0].covariance.setZero();
    refused(cycles, {}, {}, "positive definite");
    cycles[0].covariance.resize(0, 0);
    refused(cycles, {}, {}, "covariance must be 2 x 2");
    orbits::CycleResidualOptions options;
    options.gate = 1.0;
    refused(good, options, {}, "gate must be > 1");
    options = {};
    options.maximum_move = 0.0;
    refused(good, options, {}, "maximum_move");
    options = {};
    options.targets.errors.resize(1);
    refused(good, options, {}, "1 error scales");
    refused(good, {}, {MatrixXd::Zero(2, 1)}, "1 start nodes");
    refused(good, {}, std::vector<MatrixXd>(good.size(), MatrixXd::Zero(2, 7)), "start nodes of cycle 0");
    orbits::OnePeriodOptions no_floor;
    no_floor.floor = 0.0;
    CHECK_THROWS_WITH(orbits::OnePeriodResidual(c.system, c.binding, good, 0.0, c.truth(), no_floor),
                      tests::ContainsSubstring("floor"));
    const auto lotka = models::make_system("lotka_volterra");
    CHECK_THROWS_WITH(orbits::SectionMap(*lotka, 0.0, {}), tests::ContainsSubstring("autonomous"));
}

}  // namespace cycle_residual_test
