// The normal approximation is to be trusted where intervals from it are right: tests of heavy tails are with their
// reference posteriors (michaelis_menten_test.cpp), of well-behaved posteriors there and here.

#include <cmath>

#include "estimator/estimate/estimate.hpp"
#include "tests/catch.hpp"
#include "tests/estimator/interface/function_residual.hpp"
#include "tests/estimator/minimisation/nist_problems.hpp"
#include "tests/source_folder.hpp"

namespace orbid::tests::verdict_test {

TEST_CASE("NIST's Thurber is nonlinear but near enough to normal", "[estimator][reference]") {
    const NistProblem problem = read_nist_problem(orbid::tests::source_folder() + "/tests/reference/nist", "Thurber");
    FunctionResidual residual = residual_of(problem.sum, group("y"));
    std::vector<estimator::FreeParameter> parameters;
    for (std::size_t i = 0; i < problem.value.size(); ++i) {
        parameters.push_back(free_parameter("b" + std::to_string(i + 1), problem.starts[1][i]));
        parameters.back().typical_size = std::abs(problem.starts[1][i]);
    }
    const auto result = estimator::estimate(parameters, {&residual});
    CAPTURE(result.message, result.distrust);
    REQUIRE(result.status == estimator::EstimateStatus::converged);
    CHECK(result.trust_normal);
}

TEST_CASE("curvature is looked at where correlated parameters can be together", "[estimator]") {
    // e = (10 sin(a + b), (a - b) / 40): the sum is known to 0.1, each parameter to 20. Along a alone the gradient
    // turns at a tenth of its sd, where the sum has left everything that readings allow.
    FunctionResidual residual;
    estimator::Group one = group("y");
    one.scale = {false, 1.0, estimator::FlatPrior{}};
    residual.add_group(one);
    estimator::BlockLayout layout;
    layout.label = "block";
    layout.group = {0, 0};
    residual.add_block(layout, [](const Eigen::VectorXd& theta, const Eigen::VectorXd&, bool) {
        const double sum = theta[0] + theta[1];
        estimator::BlockValue value;
        value.e = Eigen::Vector2d(10.0 * std::sin(sum), (theta[0] - theta[1]) / 40.0);
        value.e_theta.resize(2, 2);
        value.e_theta << 10.0 * std::cos(sum), 10.0 * std::cos(sum), 1.0 / 40.0, -1.0 / 40.0;
        value.e_z.resize(2, 0);
        return value;
    });
    const auto result = estimator::estimate({free_parameter("a", 0.02), free_parameter("b", 0.01)}, {&residual});
    CAPTURE(result.message, result.distrust);
    REQUIRE(result.status == estimator::EstimateStatus::converged);
    CHECK(result.trust_normal);
    // Along the sum: 100 sin(s) cos(s) at 0.01 on both sides, over 0.01, beside 100.
    const double along_sum = std::sin(0.02) / 0.02;
    for (const double ratio : result.hessian_ratio)
        CHECK_THAT(ratio, WithinRel(std::sqrt((0.01 / along_sum + 1600.0) / (0.01 + 1600.0)), 1e-9));
}

namespace {

/// 1200 pairs (z, z + k exp p) read with an sd of 1, exactly: at its best z, twice the objective is n k^2 (exp p - 1)^2
/// / 2 above its minimum at p = 0. Latent states follow k exp p, so that a straight course leaves it.
FunctionResidual pairs(double sd) {
    constexpr int count = 1200;
    const double k = std::sqrt(2.0 / count) / sd;
    FunctionResidual residual;
    estimator::Group one = group("y");
    one.scale = {false, 1.0, estimator::FlatPrior{}};
    residual.add_group(one);
    for (int b = 0; b < count; ++b) {
        estimator::BlockLayout layout;
        layout.label = "pair";
        layout.group = {0, 0};
        layout.latents = 1;
        residual.add_block(
            layout,
            [k](const Eigen::VectorXd& theta, const Eigen::VectorXd& z, bool) {
                const double f = k * std::exp(theta[0]);
                estimator::BlockValue value;
                value.e = Eigen::Vector2d(-z[0], k - z[0] - f);
                value.e_theta = Eigen::Vector2d(0.0, -f);
                value.e_z = Eigen::Vector2d(-1.0, -1.0);
                return value;
            },
            Eigen::VectorXd::Constant(1, 0.01));
    }
    return residual;
}

}  // namespace

TEST_CASE("long data are judged by their objective two sds to both sides", "[estimator]") {
    // Roots are (exp(2 sd) - 1) / sd and (1 - exp(-2 sd)) / sd: 2.74 and 1.50 leave 6.9 % outside, 3.44 and 1.26 leave
    // 10 %.
    for (const double sd : {0.3, 0.5}) {
        const FunctionResidual residual = pairs(sd);
        const auto result = estimator::estimate({free_parameter("p", 0.05)}, {&residual});
        CAPTURE(sd, result.message, result.distrust);
        REQUIRE(result.status == estimator::EstimateStatus::converged);
        CHECK_THAT(result.parameters[0].sd, WithinRel(sd, 1e-6));
        CHECK(result.trust_normal == (sd < 0.4));
        if (result.trust_normal) continue;
        CHECK_THAT(result.distrust, ContainsSubstring("below the estimate the objective says 1.3 sds"));
        CHECK_THAT(result.distrust, ContainsSubstring("above the estimate the objective says 3.4 sds"));
    }
}

}  // namespace orbid::tests::verdict_test
