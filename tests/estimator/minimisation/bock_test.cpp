// Bock and Sager's Lotka-Volterra problem (tests/reference/bock_lotka_volterra): multiple shooting with matching
// conditions from far starts, and the same estimate by single shooting from the solution.

#include <cmath>

#include "tests/estimator/estimate/reference_case.hpp"

namespace orbid::tests::bock_test {

namespace {

constexpr double p1 = 0.6939711;
constexpr double p2 = 0.3409215;
constexpr double x0 = 1.0063485;
constexpr double y0 = 1.0150840;
constexpr double sum_of_squares = 23.0308714758;
/// 23.03 / 18: 22 readings less four unknowns.
constexpr double variance_factor = 1.27949286;
constexpr double variance_p1 = 6.31058720e-4;
constexpr double covariance_p = 8.10760728e-6;
constexpr double variance_p2 = 1.44983639e-5;
/// The published covariance is printed with nine digits.
constexpr double printed = 1e-6;

void check_covariance(const Eigen::MatrixXd& covariance, double factor) {
    CHECK_THAT(covariance(0, 0), WithinRel(factor * variance_p1, printed));
    CHECK_THAT(covariance(1, 0), WithinRel(factor * covariance_p, printed));
    CHECK_THAT(covariance(1, 1), WithinRel(factor * variance_p2, printed));
}

double weighted_sum(const estimator::Estimate& result, const estimator::Residual& residual) {
    double sum = 0.0;
    for (std::size_t b = 0; b < residual.layout().size(); ++b)
        sum += result.residuals[0][b].e.cwiseQuotient(residual.layout()[b].deviation).squaredNorm();
    return sum;
}

estimator::Estimate from(NodeChainResidual& residual, double start1, double start2,
                         estimator::Variance variance = estimator::Variance::restricted) {
    estimator::EstimateOptions options;
    options.variance = variance;
    options.step_tolerance = 1e-8;
    options.maximum_iterations = 500;
    std::vector<estimator::FreeParameter> parameters{free_parameter("p1", start1), free_parameter("p2", start2)};
    return estimator::estimate(parameters, {&residual}, {}, options);
}

}  // namespace

TEST_CASE("Bock's problem by multiple shooting from three starts", "[estimator][reference]") {
    for (const Eigen::Vector2d& start :
         {Eigen::Vector2d(0.0, 0.0), Eigen::Vector2d(5.0, 5.0), Eigen::Vector2d(0.2, 3.0)})
        for (const bool estimate_factor : {false, true}) {
            NodeChainResidual residual = bock_multiple_shooting(estimate_factor);
            const auto result = from(residual, start[0], start[1]);
            CAPTURE(start[0], start[1], estimate_factor, result.message, result.iterations, result.evaluations);
            REQUIRE(result.status == estimator::EstimateStatus::converged);
            // Printed to seven decimals.
            CHECK_THAT(result.parameters[0].value, WithinAbs(p1, 1e-7));
            CHECK_THAT(result.parameters[1].value, WithinAbs(p2, 1e-7));
            CHECK_THAT(result.latents[0][0][0], WithinAbs(x0, 1e-7));
            CHECK_THAT(result.latents[0][0][1], WithinAbs(y0, 1e-7));
            CHECK_THAT(weighted_sum(result, residual), WithinAbs(sum_of_squares, 1e-9));
            // The published covariance holds the variance factor 23.03 / 18, which is the restricted s^2.
            check_covariance(result.covariance, estimate_factor ? 1.0 : 1.0 / variance_factor);
            if (estimate_factor) {
                CHECK_THAT(result.scales[0].value, WithinRel(std::sqrt(variance_factor), 1e-8));
                CHECK_THAT(result.scales[0].uncertainty, WithinRel(std::sqrt(variance_factor / 36.0), 1e-6));
            }
            CHECK_THAT(result.degrees_of_freedom, WithinAbs(18.0, 0.0));
            CHECK(result.trust_normal);
            // The matching conditions hold to the accuracy of a flow over one unit of time.
            const auto at_end = residual.evaluate(
                residual.initial_set(), Eigen::Vector2d(result.parameters[0].value, result.parameters[1].value),
                result.latents[0], false);
            for (const auto& value : at_end)
                if (value.c.size() > 0) CHECK(value.c.cwiseAbs().maxCoeff() < 1e-9);
        }
}

TEST_CASE("Bock's problem: single and multiple shooting are one estimate", "[estimator][reference]") {
    FlowResidual single = bock_single_shooting(true);
    NodeChainResidual nodes = bock_multiple_shooting(true);
    estimator::EstimateOptions options;
    options.step_tolerance = 1e-8;
    const auto one = estimator::estimate(
        {free_parameter("p1", 0.7), free_parameter("p2", 0.35), free_parameter("x0", 1.0), free_parameter("y0", 1.0)},
        {&single}, {}, options);
    const auto many = from(nodes, 0.2, 3.0);
    CAPTURE(one.message, many.message);
    REQUIRE(one.status == estimator::EstimateStatus::converged);
    REQUIRE(many.status == estimator::EstimateStatus::converged);
    CHECK(one.trust_normal);
    check_covariance(one.covariance.topLeftCorner(2, 2), 1.0);
    for (std::size_t i = 0; i < 2; ++i) {
        CHECK_THAT(many.parameters[i].value, WithinRel(one.parameters[i].value, 1e-9));
        CHECK_THAT(many.parameters[i].sd, WithinRel(one.parameters[i].sd, 1e-7));
        CHECK_THAT(many.parameters[i].lower95, WithinRel(one.parameters[i].lower95, 1e-6));
        CHECK_THAT(many.latents[0][0][static_cast<Eigen::Index>(i)], WithinRel(one.parameters[i + 2].value, 1e-9));
        CHECK_THAT(many.latent_sds[0][0][static_cast<Eigen::Index>(i)], WithinRel(one.parameters[i + 2].sd, 1e-7));
    }
    CHECK_THAT(many.scales[0].value, WithinRel(one.scales[0].value, 1e-9));
    CHECK_THAT(many.log_likelihood, WithinRel(one.log_likelihood, 1e-10));
}

TEST_CASE("Bock's problem: maximum likelihood integrates the free initial state only", "[estimator][reference]") {
    NodeChainResidual residual = bock_multiple_shooting(true);
    const auto result = from(residual, 0.0, 0.0, estimator::Variance::ml);
    CAPTURE(result.message);
    REQUIRE(result.status == estimator::EstimateStatus::converged);
    // 22 readings; of 22 latent numbers the 20 matching conditions leave two, which are integrated out: n - 2 = 20.
    CHECK_THAT(result.scales[0].value, WithinRel(std::sqrt(sum_of_squares / 20.0), 1e-8));
}

}  // namespace orbid::tests::bock_test
