// Cycles of a series that was read through an encoder: points are readings, the quotient stands for the rate.
#include <cmath>
#include <numbers>

#include "tests/catch.hpp"
#include "tests/orbits/cycle_residuals/cycle_case.hpp"

namespace cycle_sensor_test {

using namespace orbid;
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using estimator::BlockStatus;
using tests::CycleCase;

namespace {

const std::vector<VectorXd> no_latents;

models::Sensor encoder() {
    models::Sensor sensor;
    sensor.type = models::Sensor::Type::angle_difference;
    sensor.delay = 0.01508;
    return sensor;
}

/// Readings of the reference orbits, both of a pair of angle readings with independent errors of `sd` rad: the quotient
/// shares one of them with the angle.
std::vector<orbits::Cycle> read_cycles(const CycleCase& c, double sd, std::uint64_t seed) {
    tests::NormalNumbers normal(seed);
    std::vector<orbits::Cycle> cycles = tests::measured_cycles(c.table, 1e-300, 1);
    const double delay = encoder().delay;
    Eigen::Matrix2d covariance;
    covariance << 1.0, -1.0 / delay, -1.0 / delay, 2.0 / (delay * delay);
    covariance *= sd * sd;
    for (orbits::Cycle& cycle : cycles) {
        const std::vector<double> phases(static_cast<std::size_t>(cycle.period), 0.0);
        const auto read = c.system->readings(encoder(), cycle.points, phases, c.table.theta);
        REQUIRE(read.status == models::FlowStatus::ok);
        cycle.points = read.readings;
        cycle.covariance.setZero(cycle.points.size(), cycle.points.size());
        for (Index j = 0; j < cycle.points.cols(); ++j) {
            const double first = sd * normal(), second = sd * normal();
            cycle.points.col(j) += Eigen::Vector2d(first, (second - first) / delay);
            cycle.covariance.block<2, 2>(2 * j, 2 * j) = covariance;
        }
    }
    return cycles;
}

}  // namespace

TEST_CASE("cycles of readings: zero at the truth, exact derivatives, nodes are states", "[orbits][cycles][sensor]") {
    const CycleCase c({{"l", 1.0}, {"k3", 1.0}});
    const auto exact = read_cycles(c, 1e-300, 1);
    auto told = exact;
    for (orbits::Cycle& cycle : told)
        cycle.covariance.setIdentity();
    orbits::CycleResidualOptions options;
    options.targets.sensor = encoder();
    const orbits::CycleResidual residual(c.system, c.binding, told, 0.0, c.truth(), {}, options);
    REQUIRE(residual.layout().size() == 41);
    const auto at = residual.evaluate(residual.initial_set(), c.truth(), no_latents, true);
    for (Index k = 0; k < 2; ++k) {
        VectorXd up = c.truth(), down = c.truth();
        const double h = 1e-5 * up(k);
        up(k) += h;
        down(k) -= h;
        const auto above = residual.evaluate(residual.initial_set(), up, no_latents, false),
                   below = residual.evaluate(residual.initial_set(), down, no_latents, false);
        for (std::size_t b = 0; b < at.size(); ++b) {
            CAPTURE(k, residual.layout()[b].label);
            REQUIRE(at[b].status == BlockStatus::ok);
            // Orbits are good to 1e-11 (tests/periodic); the quotient divides angle errors by 0.015 s.
            CHECK(at[b].e.cwiseAbs().maxCoeff() < 1e-8);
            const VectorXd difference = (above[b].e - below[b].e) / (2.0 * h);
            // Truncation 1e-10 x third derivative relative to the first (1e4 over a chaotic period).
            CHECK((difference - at[b].e_theta.col(k)).cwiseAbs().maxCoeff() <
                  1e-4 * at[b].e_theta.col(k).cwiseAbs().maxCoeff());
        }
    }

    orbits::LiftedCycleOptions lifted_options;
    lifted_options.targets = options.targets;
    const orbits::LiftedCycleResidual lifted(c.system, c.binding, told, 0.0, c.truth(), lifted_options);
    const auto latents = lifted.initial_latents();
    const auto start = lifted.evaluate(lifted.initial_set(), c.truth(), latents, true);
    for (std::size_t b = 0; b < start.size(); ++b) {
        // Readings are inverted to 1e-12; defects grow with the flow, by 60 at most.
        CHECK(start[b].e.cwiseAbs().maxCoeff() < 1e-7);
        for (const Index k : {Index{0}, Index{1}}) {
            auto up = latents, down = latents;
            up[b](k) += 1e-6;
            down[b](k) -= 1e-6;
            const VectorXd difference = (lifted.evaluate(lifted.initial_set(), c.truth(), up, false)[b].e -
                                         lifted.evaluate(lifted.initial_set(), c.truth(), down, false)[b].e) /
                                        2e-6;
            // Truncation 1e-12 x third derivative, rounding 1e-10 / 1e-6 on derivatives of the order of 50.
            CHECK((difference - start[b].e_z.col(k)).cwiseAbs().maxCoeff() < 1e-3);
        }
        if (b == 5) break;
    }

    orbits::OnePeriodOptions one_period_options;
    one_period_options.targets = options.targets;
    const orbits::OnePeriodResidual prediction(c.system, c.binding, told, 0.0, c.truth(), one_period_options);
    for (const auto& block : prediction.evaluate(prediction.initial_set(), c.truth(), no_latents, false))
        CHECK(block.e.cwiseAbs().maxCoeff() < 1e-7);

    options.targets.sensor.type = models::Sensor::Type::function;
    CHECK_THROWS_WITH(orbits::CycleResidual(c.system, c.binding, told, 0.0, c.truth(), {}, options),
                      tests::ContainsSubstring("formulas"));
}

TEST_CASE("cycles of readings: unbiased with the sensor, inconsistent without", "[orbits][cycles][sensor]") {
    const CycleCase c({{"l", 1.01}, {"k3", 1.1}});
    const auto cycles = read_cycles(c, 1e-5, 2);
    orbits::CycleResidualOptions options;
    options.targets.sensor = encoder();
    orbits::CycleResidual residual(c.system, c.binding, cycles, 0.0, tests::starts(c.parameters), {}, options);
    const auto estimate = estimator::estimate(c.parameters, {&residual});
    REQUIRE(estimate.status == estimator::EstimateStatus::converged);
    CHECK(estimate.counts[0].used == 41);
    orbits::CycleResidual blind(c.system, c.binding, cycles, 0.0, tests::starts(c.parameters));
    const auto biased = estimator::estimate(c.parameters, {&blind});
    for (std::size_t i = 0; i < 2; ++i) {
        const double truth = c.truth()(static_cast<Index>(i));
        CAPTURE(estimate.parameters[i].name, estimate.parameters[i].value / truth, estimate.parameters[i].sd / truth);
        CHECK(std::abs(estimate.parameters[i].value - truth) < 4.0 * estimate.parameters[i].sd);
    }
    for (const estimator::EstimatedScale& scale : estimate.scales)
        CHECK(std::abs(scale.value - 1.0) < 5.0 * scale.uncertainty);
    // Taken for states, quotients are off by up to 0.1 rad/s: a hundred times their errors.
    CHECK(biased.scales[1].value > 10.0);
}

}  // namespace cycle_sensor_test
