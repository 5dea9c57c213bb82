// Residuals that go through stages: a matching sd that update_active_set() lowers, with rough minimisations on the way.

#include <algorithm>
#include <cmath>

#include "tests/catch.hpp"
#include "tests/estimator/interface/function_residual.hpp"
#include "tests/estimator/interface/map_chain_residual.hpp"

namespace orbid::tests::intermediate_stage_test {

namespace {

using estimator::EstimateStatus;

constexpr double noise = 1e-2;

MapChainResidual staged(const Eigen::MatrixXd& readings, double reading_scale, std::vector<double> stages) {
    const double last = stages.empty() ? 1e-5 : stages.back();
    return {
        henon, readings, group("reading", reading_scale), {false, group("matching", last, false), std::move(stages)}};
}

estimator::Estimate estimate_from(MapChainResidual& residual, double a, double b, int rounds = 20) {
    estimator::EstimateOptions options;
    options.maximum_rounds = rounds;
    options.step_tolerance = 1e-8;
    return estimator::estimate({free_parameter("a", a), free_parameter("b", b)}, {&residual}, {}, options);
}

}  // namespace

TEST_CASE("stages of matching lead from a bad start to the estimate of the last one", "[estimator][provisional]") {
    const Eigen::MatrixXd readings = henon_readings(300, noise, 7);
    MapChainResidual direct = staged(readings, 0.0, {1e-2, 1e-3, 1e-4, 1e-5});
    const auto reference = estimate_from(direct, 1.4, 0.3);
    CAPTURE(reference.message);
    REQUIRE(reference.status == EstimateStatus::converged);
    // The scale is what the readings were made with, to its own uncertainty.
    CHECK_THAT(reference.scales[0].value, WithinAbs(noise, 4.0 * reference.scales[0].uncertainty));
    for (std::size_t i = 0; i < 2; ++i)
        CHECK_THAT(reference.parameters[i].value, WithinAbs(i == 0 ? 1.4 : 0.3, 4.0 * reference.parameters[i].sd));

    // With 0 the scale of the readings starts from the residuals, wherever the states start; else it stays where it is
    // until the last stage.
    for (const double scale : {0.0, 0.05, 1e-3}) {
        MapChainResidual residual = staged(readings, scale, {0.3, 0.03, 3e-3, 3e-4, 1e-5});
        const auto found = estimate_from(residual, 1.1, 0.1, 1);  // provisional rounds do not count
        CAPTURE(scale, found.message);
        REQUIRE(found.status == EstimateStatus::converged);
        CHECK(found.rounds == 5);
        for (std::size_t i = 0; i < 2; ++i)
            CHECK_THAT(found.parameters[i].value,
                       WithinAbs(reference.parameters[i].value, 1e-5 * reference.parameters[i].sd));
        CHECK_THAT(found.scales[0].value, WithinRel(reference.scales[0].value, 1e-6));
        for (const estimator::StepRecord& step : found.history) {
            CHECK(step.provisional == (step.round < 5));
            if (step.provisional) CHECK(step.block == estimator::StepBlock::theta);
        }
        REQUIRE(residual.scales_seen.size() == 4);
        const std::vector<double> stages{0.3, 0.03, 3e-3, 3e-4};
        for (std::size_t k = 0; k < 4; ++k) {
            CHECK_THAT(residual.scales_seen[k][1], WithinRel(stages[k], 1e-12));
            if (scale > 0.0) CHECK_THAT(residual.scales_seen[k][0], WithinRel(scale, 1e-12));
        }
        // At the end of the last loose stage an unknown scale has grown into its own.
        if (!(scale > 0.0)) CHECK_THAT(residual.scales_seen[3][0], WithinRel(noise, 0.5));
    }
}

TEST_CASE("a provisional round ends after few steps", "[estimator][provisional]") {
    MapChainResidual residual = staged(henon_readings(300, noise, 7), 0.02, {0.3, 0.1, 0.03, 0.01, 1e-3, 1e-4, 1e-5});
    const auto found = estimate_from(residual, 1.1, 0.1);
    REQUIRE(found.status == EstimateStatus::converged);
    for (int round = 1; round < 7; ++round) {
        const auto accepted = std::count_if(found.history.begin(), found.history.end(),
                                            [round](const auto& step) { return step.round == round && step.accepted; });
        CAPTURE(round);
        CHECK(accepted >= 1);
        CHECK(accepted <= 5);
    }
}

TEST_CASE("a residual that stays provisional is given up", "[estimator][provisional]") {
    class Endless : public FunctionResidual {
    public:
        [[nodiscard]] estimator::ActiveSet initial_set() const override {
            estimator::ActiveSet active = FunctionResidual::initial_set();
            active.is_intermediate_stage = true;
            return active;
        }
    };
    Endless residual;
    residual.add_group(group("reading", 0.5));
    residual.add_block(layout("all", 4), linear(Eigen::Vector4d(1, 2, 3, 4), Eigen::MatrixXd::Ones(4, 1)));
    const auto found = estimator::estimate({free_parameter("mean", 0.0)}, {&residual});
    CHECK(found.status == EstimateStatus::iteration_limit);
    CHECK_THAT(found.message, ContainsSubstring("provisional"));
    CHECK_THAT(found.parameters[0].value, WithinAbs(2.5, 1e-12));
    CHECK_THAT(found.scales[0].value, WithinRel(0.5, 1e-14));
}

}  // namespace orbid::tests::intermediate_stage_test
