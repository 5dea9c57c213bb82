// ln|multiplier| of cycles as data, beside their points and alone.
#include <cmath>
#include <limits>

#include "tests/catch.hpp"
#include "tests/orbits/cycle_residuals/cycle_case.hpp"

namespace cycle_multipliers_test {

using namespace orbid;
using Eigen::Index;
using Eigen::VectorXd;
using estimator::BlockStatus;
using tests::CycleCase;

namespace {

const std::vector<VectorXd> no_latents;

/// Cycles with the multipliers of the reference, measured with normal errors of `error` in ln|multiplier|.
std::vector<orbits::Cycle> with_multipliers(const tests::ReferenceOrbits& table, std::vector<orbits::Cycle> cycles,
                                            double error, std::uint64_t seed) {
    tests::NormalNumbers normal(seed);
    std::size_t c = 0;
    for (const tests::ReferenceOrbit& orbit : table.orbits)
        for (int side = 0; side < (orbit.mirror_symmetric ? 1 : 2); ++side) {
            orbits::Cycle& cycle = cycles.at(c++);
            cycle.multipliers = {orbit.unstable_multiplier, orbit.stable_multiplier};
            cycle.ln_multiplier.resize(2);
            for (Index m = 0; m < 2; ++m)
                cycle.ln_multiplier(m) =
                    std::log(std::abs(cycle.multipliers[static_cast<std::size_t>(m)])) + error * normal();
            cycle.ln_multiplier_covariance = error * error * Eigen::Matrix2d::Identity();
        }
    return cycles;
}

orbits::CycleResidualOptions with(bool positions, bool multipliers) {
    orbits::CycleResidualOptions options;
    options.targets.positions = positions;
    options.targets.multipliers = multipliers;
    return options;
}

}  // namespace

TEST_CASE("cycle multipliers: the reference's at the truth, exact derivatives, states of rest", "[orbits][cycles]") {
    const CycleCase c({{"l", 1.0}, {"k2", 1.0}, {"k3", 1.0}});
    const auto cycles = with_multipliers(c.table, tests::measured_cycles(c.table, 1e-6, 1), 1e-300, 1);
    auto told = cycles;
    for (orbits::Cycle& cycle : told)
        cycle.ln_multiplier_covariance = 1e-12 * Eigen::Matrix2d::Identity();
    const orbits::CycleResidual residual(c.system, c.binding, told, 0.0, c.truth(), {}, with(true, true));
    REQUIRE(residual.layout().size() == 43);  // all: (0, 0) and (pi, 0) with their multipliers alone
    CHECK(residual.at_rest() == std::vector<std::size_t>{2, 5});
    REQUIRE(residual.groups().size() == 3);
    CHECK(residual.groups()[2].name == "cycles.ln_multiplier");
    CHECK(residual.groups()[2].unit == "1");
    CHECK(residual.groups()[2].factor);
    const auto at = residual.evaluate(residual.initial_set(), c.truth(), no_latents, true);
    for (std::size_t b = 0; b < at.size(); ++b) {
        CAPTURE(residual.layout()[b].label);
        REQUIRE(at[b].status == BlockStatus::ok);
        const bool rest = residual.cycle_of(b) == 2 || residual.cycle_of(b) == 5;
        const Index points = rest ? 0 : told[residual.cycle_of(b)].points.size();
        REQUIRE(at[b].e.size() == points + 2);
        // The table has 12 digits of unstable and 7 of stable multipliers; flow tolerance 1e-12, amplified.
        CHECK(std::abs(at[b].e(points)) < 1e-9);
        CHECK(std::abs(at[b].e(points + 1)) < 1e-6);
    }
    for (Index k = 0; k < 3; ++k) {
        VectorXd up = c.truth(), down = c.truth();
        const double h = 1e-5 * up(k);
        up(k) += h;
        down(k) -= h;
        const auto above = residual.evaluate(residual.initial_set(), up, no_latents, false),
                   below = residual.evaluate(residual.initial_set(), down, no_latents, false);
        for (std::size_t b = 0; b < at.size(); ++b) {
            CAPTURE(k, residual.layout()[b].label);
            const VectorXd difference = (above[b].e - below[b].e).tail(2) / (2.0 * h);
            // Truncation 1e-10 x third derivative relative to the first (1e5 for ln|multiplier|), rounding 1e-10 /
            // 1e-5. A state of rest lies on the surface where friction switches: its crossings, located from velocities
            // of 1e-13, leave up to 9e-4 of second derivatives (measured), of the values nothing.
            const bool rest = residual.cycle_of(b) == 2 || residual.cycle_of(b) == 5;
            CHECK((difference - at[b].e_theta.col(k).tail(2)).cwiseAbs().maxCoeff() <
                  (rest ? 1e-2 : 1e-4) * at[b].e_theta.col(k).tail(2).cwiseAbs().maxCoeff() + 1e-5 / c.truth()(k));
        }
    }
}

TEST_CASE("cycle multipliers: what takes part", "[orbits][cycles]") {
    const CycleCase c({{"l", 1.0}});
    auto cycles = with_multipliers(c.table, tests::measured_cycles(c.table, 1e-6, 1), 1e-3, 1);
    cycles[0].ln_multiplier(1) = -std::numeric_limits<double>::infinity();  // sticking, as the analysis says it
    cycles[0].ln_multiplier_covariance(1, 1) = std::numeric_limits<double>::infinity();
    cycles[1].ln_multiplier_covariance(1, 1) = 0.6 * 0.6;  // hardly known
    cycles[3].ln_multiplier.resize(0);                     // not measured
    cycles[3].multipliers.clear();
    cycles[4].multipliers = {{0.6, 0.8}, {0.6, -0.8}};  // a pair: one modulus
    cycles[4].ln_multiplier.setZero();
    const orbits::SectionMap map(*c.system, 0.0, {1e-12, 1e-12, 20000});
    const auto targets = select_targets(map, c.table.theta, c.binding.parameter, cycles, with(true, true).targets);
    CHECK(targets.targets[0].multipliers == std::vector<std::size_t>{0});
    CHECK(targets.targets[1].multipliers == std::vector<std::size_t>{0});
    CHECK(targets.targets[2].multipliers == std::vector<std::size_t>{0, 1});
    CHECK_FALSE(targets.targets[2].positions);
    CHECK(targets.targets[3].multipliers.empty());
    CHECK(targets.targets[4].multipliers == std::vector<std::size_t>{0});
    CHECK(targets.targets[4].pair == std::vector<bool>{true});
    CHECK(targets.targets[4].multiplier_covariance.rows() == 1);

    const auto refused = [&](const std::vector<orbits::Cycle>& list, const orbits::CycleResidualOptions& options,
                             const std::string& rule) {
        CHECK_THROWS_WITH(orbits::CycleResidual(c.system, c.binding, list, 0.0, c.truth(), {}, options),
                          tests::ContainsSubstring(rule));
    };
    refused(cycles, with(false, false), "positions or multipliers");
    refused(tests::measured_cycles(c.table, 1e-6, 1), with(true, true), "none was measured");
    auto wrong = cycles;
    wrong[8].ln_multiplier_covariance.resize(0, 0);
    refused(wrong, with(true, true), "cycle 8: covariance of ln|multiplier| must be 2 x 2");
    wrong = cycles;
    wrong[8].ln_multiplier.conservativeResize(1);
    refused(wrong, with(true, true), "cycle 8: has 2 multipliers and 1 values");
    auto options = with(true, true);
    options.targets.weights = orbits::CycleWeights::equal;
    for (orbits::Cycle& cycle : cycles)
        cycle.ln_multiplier_covariance.resize(0, 0);
    options.targets.multiplier_error = {false, 0.01, estimator::FlatPrior{}};
    const orbits::CycleResidual equal(c.system, c.binding, cycles, 0.0, c.truth(), {}, options);
    CHECK(equal.layout()[0].shape.size() == 0);
    CHECK_FALSE(equal.groups()[2].factor);
    CHECK(equal.groups()[2].scale.value == 0.01);
}

TEST_CASE("cycle multipliers: a state that sticks has none", "[orbits][cycles]") {
    CycleCase c({{"l", 1.0}});
    c.binding.base(c.system->parameter_index("k1")) = 1e-3;
    const auto cycles = with_multipliers(c.table, tests::measured_cycles(c.table, 1e-6, 1), 1e-3, 1);
    const orbits::CycleResidual residual(c.system, c.binding, cycles, 0.0, c.truth(), {}, with(true, true));
    REQUIRE(residual.layout().size() == 43);
    for (std::size_t b = 0; b < 43; ++b) {
        const bool rest = residual.cycle_of(b) == 2 || residual.cycle_of(b) == 5;
        if (rest) CHECK_FALSE(residual.layout()[b].active);
    }
}

TEST_CASE("cycle multipliers alone give length and frictions", "[orbits][cycles]") {
    // Known to 5e-4 they give l, k2, k3 to 1e-4, 1 %, 0.2 % (the bounds on the sds).
    const CycleCase c({{"l", 1.002}, {"k2", 1.1}, {"k3", 0.95}});
    const auto cycles = with_multipliers(c.table, tests::measured_cycles(c.table, 1e-4, 3), 5e-4, 3);
    orbits::CycleResidual residual(c.system, c.binding, cycles, 0.0, tests::starts(c.parameters), {},
                                   with(false, true));
    REQUIRE(residual.groups().size() == 1);
    CHECK(residual.layout()[0].group == std::vector<int>{0, 0});
    const auto estimate = estimator::estimate(c.parameters, {&residual});
    REQUIRE(estimate.status == estimator::EstimateStatus::converged);
    const std::vector<double> largest{1e-4, 1e-2, 2e-3};
    for (std::size_t i = 0; i < 3; ++i) {
        const estimator::Estimated& parameter = estimate.parameters[i];
        const double truth = c.truth()(static_cast<Index>(i));
        CAPTURE(parameter.name, parameter.value / truth, parameter.sd / truth);
        CHECK(std::abs(parameter.value - truth) < 4.0 * parameter.sd);
        CHECK(parameter.sd < largest[i] * truth);
    }
}

}  // namespace cycle_multipliers_test
