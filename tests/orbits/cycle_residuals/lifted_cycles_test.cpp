// Orbits and parameters together: exact matching, heavy tails, wrong matches.
#include <cmath>

#include "tests/catch.hpp"
#include "tests/orbits/cycle_residuals/cycle_case.hpp"

namespace lifted_cycles_test {

using namespace orbid;
using Eigen::Index;
using Eigen::VectorXd;
using tests::CycleCase;

namespace {

orbits::LiftedCycleResidual lifted(const CycleCase& c, const std::vector<orbits::Cycle>& cycles,
                                   const orbits::LiftedCycleOptions& options) {
    return {c.system, c.binding, cycles, 0.0, tests::starts(c.parameters), options};
}

estimator::EstimateOptions rough() {
    estimator::EstimateOptions options;
    options.variance = estimator::Variance::ml;
    options.step_tolerance = 1e-2;
    return options;
}

}  // namespace

TEST_CASE("lifted cycles: constraints are the matching records", "[orbits][cycles]") {
    const CycleCase c({{"l", 1.02}, {"k3", 0.9}});
    const auto cycles = tests::measured_cycles(c.table, 1e-4, 1);
    orbits::LiftedCycleOptions options;
    const auto soft = lifted(c, cycles, options);
    options.exact = true;
    auto exact = lifted(c, cycles, options);
    REQUIRE(exact.groups().size() == 1);
    CHECK(exact.layout()[3].constraints == exact.layout()[3].latents);
    CHECK(exact.layout()[3].constraint_size == soft.scale().replicate(exact.layout()[3].latents / 2, 1));
    const VectorXd theta = tests::starts(c.parameters);
    const auto latents = soft.initial_latents();
    const auto a = soft.evaluate(soft.initial_set(), theta, latents, true),
               b = exact.evaluate(exact.initial_set(), theta, latents, true);
    for (std::size_t k = 0; k < a.size(); ++k) {
        const Index records = latents[k].size();
        CHECK(a[k].e.tail(records) == b[k].c);
        CHECK(a[k].e_theta.bottomRows(records) == b[k].c_theta);
        CHECK(a[k].e_z.bottomRows(records) == b[k].c_z);
        CHECK(a[k].e.head(records) == b[k].e);
    }
    CHECK((soft.matching_defect(soft.initial_set(), theta, latents) -
           exact.matching_defect(exact.initial_set(), theta, latents))
              .isZero());
    for (const double distance : soft.distances(soft.initial_set(), theta, latents))
        CHECK(distance < 1e-12);  // nodes on the points

    // 2 % and 10 % off the nodes are orbits after one estimate, which is the truth within its errors.
    const auto estimate = estimator::estimate(c.parameters, {&exact}, {}, rough());
    CHECK(estimate.status == estimator::EstimateStatus::converged);
    const auto defects = exact.matching_defect(estimate.active.front(),
                                               VectorXd{{estimate.parameters[0].value, estimate.parameters[1].value}},
                                               estimate.latents.front());
    CHECK((defects.array() / exact.scale().array()).maxCoeff() < 1e-7);
    for (std::size_t i = 0; i < 2; ++i)
        CHECK(std::abs(estimate.parameters[i].value - c.truth()(static_cast<Index>(i))) <
              4.0 * estimate.parameters[i].sd);
}

TEST_CASE("lifted cycles: heavy tails lead from a start that normal errors miss", "[orbits][cycles]") {
    // Without the one-period prediction: a length 30 % off.
    const CycleCase c({{"l", 1.3}, {"k2", 3.0}, {"k3", 3.0}});
    const auto cycles = tests::measured_cycles(c.table, 1e-3, 2);
    orbits::LiftedCycleOptions options;
    options.matching = estimator::StudentErrors{{false, 4.0, estimator::FlatPrior{}}};
    options.points = options.matching;
    options.targets.periods = {1, 2};
    options.matching_start = 0.16;
    options.matching_factor = 0.3;
    options.matching_end = 1e-4;
    auto tailed = lifted(c, cycles, options);
    CHECK(std::holds_alternative<estimator::StudentErrors>(tailed.groups()[1].distribution));
    auto parameters = c.parameters;
    const auto move_to = [&](const estimator::Estimate& estimate) {
        REQUIRE(estimate.parameters.size() == 3);
        for (std::size_t i = 0; i < 3; ++i)
            parameters[i].start = estimate.parameters[i].value;
    };
    const auto far = estimator::estimate(parameters, {&tailed}, {}, rough());
    move_to(far);
    CHECK_FALSE(far.active.front().is_intermediate_stage);
    CHECK_THAT(parameters[0].start / c.truth()(0), tests::WithinAbs(1.0, 0.03));

    orbits::LiftedCycleOptions plain;
    plain.targets.periods = {1, 2};
    orbits::LiftedCycleResidual residual(c.system, c.binding, cycles, 0.0, tests::starts(parameters), plain);
    const auto estimate = estimator::estimate(parameters, {&residual}, {}, rough());
    CHECK(estimate.status == estimator::EstimateStatus::converged);
    for (std::size_t i = 0; i < 3; ++i) {
        CAPTURE(estimate.parameters[i].value / c.truth()(static_cast<Index>(i)), estimate.parameters[i].sd);
        CHECK(std::abs(estimate.parameters[i].value - c.truth()(static_cast<Index>(i))) <
              4.0 * estimate.parameters[i].sd);
    }
}

TEST_CASE("cycles: one in ten matched to a wrong orbit is rejected", "[orbits][cycles]") {
    const CycleCase c({{"l", 1.1}, {"k3", 1.3}});
    auto cycles = tests::measured_cycles(c.table, 1e-6, 6);
    const std::vector<std::size_t> wrong{8, 15, 20, 30};
    for (const std::size_t k : wrong)
        cycles[k].points.row(1).array() += 0.01 * 29.3;  // 10 000 sds
    const auto estimate = estimate_from_cycles(c, cycles);
    CHECK(estimate.status == estimator::EstimateStatus::converged);
    CHECK(estimate.counts.at(0).used == 37);
    CHECK(estimate.counts.at(0).rejected == 4);
    CHECK(estimate.counts.at(0).lost == 0);
    for (Index i = 0; i < 2; ++i) {
        const auto& parameter = estimate.parameters[static_cast<std::size_t>(i)];
        CAPTURE(parameter.name, parameter.value / c.truth()(i), parameter.sd / c.truth()(i));
        CHECK(std::abs(parameter.value - c.truth()(i)) < 4.0 * parameter.sd);
    }
}

}  // namespace lifted_cycles_test
